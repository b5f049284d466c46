// Detector port: pixels in, rows in a ring in data memory out, as a DMA would deliver them.
//
// Two pixels make a word, the first in the lower half. A row of an odd number of pixels ends with a
// half-filled word, so that each row starts at a word. A restart tells how many pixels a frame has;
// the last of them ends its row, however short. Between frames and while the ring is full the port
// takes no pixels; a detector that cannot wait for the ring loses them and sets the overrun flag.
module detector_port #(
  parameter int unsigned AddrWidth = 17
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,
  // From the detector.
  input  logic                 pixel_valid_i,
  input  logic [15:0]          pixel_i,
  output logic                 pixel_ready_o,
  // Registers.
  input  logic                 restart_i,    // empties the ring, for a frame of that many pixels
  input  logic                 base_we_i,    // word address of the ring
  input  logic                 width_we_i,   // pixels in a row, at least 1
  input  logic                 ring_we_i,    // rows in the ring, at least 1
  input  logic                 taken_i,      // that many rows were taken out
  input  logic [31:0]          wdata_i,
  output logic [31:0]          rows_o,       // rows completed and not taken
  output logic                 overrun_o,
  // To data memory.
  output logic                 mem_req_o,
  output logic [AddrWidth-1:0] mem_addr_o,
  output logic [31:0]          mem_wdata_o
);
  logic [AddrWidth-1:0] base_q, addr_q;
  // What is written takes effect with a restart, so that no pixel meets half of a new setting.
  logic [15:0] width_q, left_q, ring_set_q, ring_q, place_q, rows_q, low_q;
  logic [31:0] frame_q;  // pixels of the frame that are to come
  logic high_q;  // the next pixel is an upper half

  logic take, row_ends;
  assign pixel_ready_o = (rows_q != ring_q) & (frame_q != '0) & ~restart_i;
  assign take = pixel_valid_i & pixel_ready_o;
  assign row_ends = (left_q == 16'd1) | (frame_q == 32'd1);

  assign mem_req_o = take & (high_q | row_ends);
  assign mem_addr_o = addr_q;
  assign mem_wdata_o = high_q ? {pixel_i, low_q} : {16'h0, pixel_i};
  assign rows_o = {16'h0, rows_q};

  logic ends_ring;
  assign ends_ring = place_q + 16'd1 == ring_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      base_q <= '0;
      width_q <= 16'd1;
      ring_set_q <= '0;
      ring_q <= '0;
      addr_q <= '0;
      left_q <= 16'd1;
      place_q <= '0;
      rows_q <= '0;
      low_q <= '0;
      high_q <= 1'b0;
      frame_q <= '0;
      overrun_o <= 1'b0;
    end else begin
      if (base_we_i) base_q <= wdata_i[AddrWidth-1:0];
      if (width_we_i) width_q <= wdata_i[15:0];
      if (ring_we_i) ring_set_q <= wdata_i[15:0];
      if (restart_i) begin
        ring_q <= ring_set_q;
        addr_q <= base_q;
        left_q <= width_q;
        place_q <= '0;
        rows_q <= '0;
        high_q <= 1'b0;
        frame_q <= wdata_i;
        overrun_o <= 1'b0;
      end else begin
        if (pixel_valid_i & (frame_q != '0) & ~pixel_ready_o) overrun_o <= 1'b1;
        if (take) begin
          frame_q <= frame_q - 32'd1;
          if (!high_q) low_q <= pixel_i;
          high_q <= ~high_q & ~row_ends;
          left_q <= row_ends ? width_q : left_q - 16'd1;
          if (mem_req_o) addr_q <= row_ends & ends_ring ? base_q : addr_q + 1'b1;
          if (row_ends) place_q <= ends_ring ? '0 : place_q + 16'd1;
        end
        rows_q <= rows_q + {15'h0, take & row_ends} - (taken_i ? wdata_i[15:0] : 16'h0);
      end
    end
  end
endmodule
