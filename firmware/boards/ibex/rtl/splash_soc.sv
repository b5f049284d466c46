// The soft core: Ibex (RV32IMC), tightly coupled memories of one cycle, and its periphery.
//
// Instructions and data never share a port, and the detector writes through a port of its own: no
// access ever waits, and a program's cycles depend neither on what the detector does nor on where its
// data lie.
module splash_soc
  import splash_pkg::*;
#(
  parameter int unsigned ImemWords = 32 * 1024,
  parameter int unsigned DmemWords = 64 * 1024,
  parameter string ImemFile = ""
) (
  input  logic        clk_i,
  input  logic        rst_ni,
  // Detector.
  input  logic        pixel_valid_i,
  input  logic [15:0] pixel_i,
  output logic        pixel_ready_o,
  // Link.
  input  logic        link_in_valid_i,
  input  logic        link_in_closed_i,
  input  logic [7:0]  link_in_i,
  output logic        link_in_ready_o,
  output logic        link_out_valid_o,
  output logic [7:0]  link_out_o,
  input  logic        link_out_ready_i,
  // DACs.
  output logic        dac_valid_o,
  output logic [15:0] dac_code_o,
  output logic        dac_load_o,
  // For the outside.
  output logic        console_valid_o,
  output logic [7:0]  console_o,
  output logic        mark_o,
  output logic        done_o,
  output logic [31:0] done_code_o,
  output logic        idle_o,
  output logic [31:0] cycle_o,
  output logic        fault_o
);
  localparam int unsigned ImemWidth = $clog2(ImemWords);
  localparam int unsigned DmemWidth = $clog2(DmemWords);

  // --- core ---

  logic instr_req, data_req, data_we;
  logic instr_valid_q, data_valid_q;
  logic [31:0] instr_addr, instr_rdata, data_addr, data_wdata, data_rdata;
  logic [3:0] data_be;

  ibex_top #(
    .RV32M(ibex_pkg::RV32MSingleCycle),
    .RV32B(ibex_pkg::RV32BNone),
    .RegFile(ibex_pkg::RegFileFPGA),
    .BranchTargetALU(1'b1),
    .WritebackStage(1'b1),
    .MHPMCounterNum(0)
  ) u_core (
    .clk_i,
    .rst_ni,
    .test_en_i(1'b0),
    .ram_cfg_i('0),
    .hart_id_i('0),
    .boot_addr_i(BootAddress),
    .instr_req_o(instr_req),
    .instr_gnt_i(instr_req),
    .instr_rvalid_i(instr_valid_q),
    .instr_addr_o(instr_addr),
    .instr_rdata_i(instr_rdata),
    .instr_rdata_intg_i('0),
    .instr_err_i(1'b0),
    .data_req_o(data_req),
    .data_gnt_i(data_req),
    .data_rvalid_i(data_valid_q),
    .data_we_o(data_we),
    .data_be_o(data_be),
    .data_addr_o(data_addr),
    .data_wdata_o(data_wdata),
    .data_wdata_intg_o(),
    .data_rdata_i(data_rdata),
    .data_rdata_intg_i('0),
    .data_err_i(1'b0),
    .irq_software_i(1'b0),
    .irq_timer_i(1'b0),
    .irq_external_i(1'b0),
    .irq_fast_i('0),
    .irq_nm_i(1'b0),
    .scramble_key_valid_i(1'b0),
    .scramble_key_i('0),
    .scramble_nonce_i('0),
    .scramble_req_o(),
    .debug_req_i(1'b0),
    .crash_dump_o(),
    .double_fault_seen_o(fault_o),
    .fetch_enable_i(ibex_pkg::IbexMuBiOn),
    .alert_minor_o(),
    .alert_major_internal_o(),
    .alert_major_bus_o(),
    .core_sleep_o(),
    .scan_rst_ni(1'b1)
  );

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      instr_valid_q <= 1'b0;
      data_valid_q <= 1'b0;
    end else begin
      instr_valid_q <= instr_req;
      data_valid_q <= data_req;
    end
  end

  // --- what answers a data access ---

  logic [3:0] page, page_q;
  assign page = data_addr[31:28];
  always_ff @(posedge clk_i) begin
    if (data_req) page_q <= page;
  end

  logic [31:0] imem_rdata, dmem_rdata, peri_rdata;
  always_comb begin
    unique case (page_q)
      ImemPage: data_rdata = imem_rdata;
      DmemPage: data_rdata = dmem_rdata;
      default:  data_rdata = peri_rdata;
    endcase
  end

  // --- memories ---

  ram_dual #(
    .Words(ImemWords),
    .InitFile(ImemFile)
  ) u_imem (
    .clk_i,
    .a_req_i(instr_req),
    .a_we_i('0),
    .a_addr_i(instr_addr[ImemWidth+1:2]),
    .a_wdata_i('0),
    .a_rdata_o(instr_rdata),
    .b_req_i(data_req & (page == ImemPage)),
    .b_we_i({4{data_we}} & data_be),
    .b_addr_i(data_addr[ImemWidth+1:2]),
    .b_wdata_i(data_wdata),
    .b_rdata_o(imem_rdata)
  );

  logic det_req;
  logic [DmemWidth-1:0] det_addr;
  logic [31:0] det_wdata;

  ram_dual #(
    .Words(DmemWords)
  ) u_dmem (
    .clk_i,
    .a_req_i(data_req & (page == DmemPage)),
    .a_we_i({4{data_we}} & data_be),
    .a_addr_i(data_addr[DmemWidth+1:2]),
    .a_wdata_i(data_wdata),
    .a_rdata_o(dmem_rdata),
    .b_req_i(det_req),
    .b_we_i('1),
    .b_addr_i(det_addr),
    .b_wdata_i(det_wdata),
    .b_rdata_o()
  );

  // --- periphery ---

  logic det_restart, det_base_we, det_width_we, det_ring_we, det_taken, det_overrun;
  logic [31:0] det_rows;

  peripherals u_peripherals (
    .clk_i,
    .rst_ni,
    .req_i(data_req & (page == PeriPage)),
    .we_i(data_we),
    .addr_i(data_addr[7:0]),
    .wdata_i(data_wdata),
    .rdata_o(peri_rdata),
    .link_in_valid_i,
    .link_in_closed_i,
    .link_in_i,
    .link_in_ready_o,
    .link_out_valid_o,
    .link_out_o,
    .link_out_ready_i,
    .det_restart_o(det_restart),
    .det_base_we_o(det_base_we),
    .det_width_we_o(det_width_we),
    .det_ring_we_o(det_ring_we),
    .det_taken_o(det_taken),
    .det_rows_i(det_rows),
    .det_overrun_i(det_overrun),
    .dac_valid_o,
    .dac_code_o,
    .dac_load_o,
    .console_valid_o,
    .console_o,
    .mark_o,
    .done_o,
    .idle_o,
    .cycle_o,
    .wdata_o(done_code_o)
  );

  detector_port #(
    .AddrWidth(DmemWidth)
  ) u_detector (
    .clk_i,
    .rst_ni,
    .pixel_valid_i,
    .pixel_i,
    .pixel_ready_o,
    .restart_i(det_restart),
    .base_we_i(det_base_we),
    .width_we_i(det_width_we),
    .ring_we_i(det_ring_we),
    .taken_i(det_taken),
    .wdata_i(data_wdata),
    .rows_o(det_rows),
    .overrun_o(det_overrun),
    .mem_req_o(det_req),
    .mem_addr_o(det_addr),
    .mem_wdata_o(det_wdata)
  );
endmodule
