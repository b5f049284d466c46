// Block RAM with two ports, 32 bits each with byte enables. Both ports answer in one cycle and
// neither ever waits for the other, so that what one does costs the other no time. A write leaves
// what the port read last; what a port reads while the other writes there is not defined.
module ram_dual #(
  parameter int unsigned Words = 1024,
  // Initial content for an FPGA, one word of hexadecimal digits a line.
  parameter string InitFile = ""
) (
  input  logic                     clk_i,
  input  logic                     a_req_i,
  input  logic [3:0]               a_we_i,
  input  logic [$clog2(Words)-1:0] a_addr_i,
  input  logic [31:0]              a_wdata_i,
  output logic [31:0]              a_rdata_o,
  input  logic                     b_req_i,
  input  logic [3:0]               b_we_i,
  input  logic [$clog2(Words)-1:0] b_addr_i,
  input  logic [31:0]              b_wdata_i,
  output logic [31:0]              b_rdata_o
);
  (* no_rw_check *) logic [31:0] mem[Words]  /* verilator public_flat_rw */;

  if (InitFile != "") begin : gen_init
    initial $readmemh(InitFile, mem);
  end

  always_ff @(posedge clk_i) begin
    if (a_req_i) begin
      for (int unsigned k = 0; k < 4; k++) begin
        if (a_we_i[k]) mem[a_addr_i][8*k+:8] <= a_wdata_i[8*k+:8];
      end
      if (a_we_i == '0) a_rdata_o <= mem[a_addr_i];
    end
  end

  always_ff @(posedge clk_i) begin
    if (b_req_i) begin
      for (int unsigned k = 0; k < 4; k++) begin
        if (b_we_i[k]) mem[b_addr_i][8*k+:8] <= b_wdata_i[8*k+:8];
      end
      if (b_we_i == '0) b_rdata_o <= mem[b_addr_i];
    end
  end
endmodule
