// Registers of the soft core's periphery. Each answers in one cycle; none makes the core wait.
module peripherals
  import splash_pkg::*;
(
  input  logic        clk_i,
  input  logic        rst_ni,
  // From the core.
  input  logic        req_i,
  input  logic        we_i,
  input  logic [7:0]  addr_i,
  input  logic [31:0] wdata_i,
  output logic [31:0] rdata_o,
  // Link: a stream of bytes each way.
  input  logic        link_in_valid_i,
  input  logic        link_in_closed_i,
  input  logic [7:0]  link_in_i,
  output logic        link_in_ready_o,
  output logic        link_out_valid_o,
  output logic [7:0]  link_out_o,
  input  logic        link_out_ready_i,
  // Detector port.
  output logic        det_restart_o,
  output logic        det_base_we_o,
  output logic        det_width_we_o,
  output logic        det_ring_we_o,
  output logic        det_taken_o,
  input  logic [31:0] det_rows_i,
  input  logic        det_overrun_i,
  // DACs: codes one after the other, and the strobe that makes them the outputs.
  output logic        dac_valid_o,
  output logic [15:0] dac_code_o,
  output logic        dac_load_o,
  // For the outside: characters, moments, the program's end.
  output logic        console_valid_o,
  output logic [7:0]  console_o,
  output logic        mark_o,
  output logic        done_o,
  output logic        idle_o,  // the core looked for input and found none
  output logic [31:0] cycle_o,
  output logic [31:0] wdata_o
);
  logic read, write;
  assign read = req_i & ~we_i;
  assign write = req_i & we_i;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) cycle_o <= '0;
    else cycle_o <= cycle_o + 32'd1;
  end

  assign link_in_ready_o = read & (addr_i == RegLinkIn);
  assign link_out_valid_o = write & (addr_i == RegLinkOut);
  assign link_out_o = wdata_i[7:0];
  assign det_base_we_o = write & (addr_i == RegDetBase);
  assign det_width_we_o = write & (addr_i == RegDetWidth);
  assign det_ring_we_o = write & (addr_i == RegDetRing);
  assign det_taken_o = write & (addr_i == RegDetTaken);
  assign det_restart_o = write & (addr_i == RegDetControl);
  assign dac_valid_o = write & (addr_i == RegDacCode);
  assign dac_code_o = wdata_i[15:0];
  assign dac_load_o = write & (addr_i == RegDacLoad);
  assign console_valid_o = write & (addr_i == RegConsole);
  assign console_o = wdata_i[7:0];
  assign mark_o = write & (addr_i == RegMark);
  assign done_o = write & (addr_i == RegDone);
  assign idle_o = read & (((addr_i == RegLinkIn) & ~link_in_valid_i) |
                          ((addr_i == RegDetRows) & (det_rows_i == '0)));
  assign wdata_o = wdata_i;

  always_ff @(posedge clk_i) begin
    if (read) begin
      unique case (addr_i)
        RegCycle: rdata_o <= cycle_o;
        RegLinkIn: rdata_o <= {22'h0, link_in_closed_i, link_in_valid_i, link_in_i};
        RegLinkOut: rdata_o <= {31'h0, link_out_ready_i};
        RegDetRows: rdata_o <= det_rows_i;
        RegDetControl: rdata_o <= {31'h0, det_overrun_i};
        default: rdata_o <= '0;
      endcase
    end
  end
endmodule
