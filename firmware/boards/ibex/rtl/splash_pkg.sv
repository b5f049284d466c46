// Address map of the SPLASH soft core. `src/map.rs` has the same numbers, README.md explains them.
package splash_pkg;
  // The upper four bits of an address choose what answers.
  localparam logic [3:0] ImemPage = 4'h0;
  localparam logic [3:0] DmemPage = 4'h1;
  localparam logic [3:0] PeriPage = 4'h2;

  // Ibex starts at this address + 0x80 and finds its trap vectors at it.
  localparam logic [31:0] BootAddress = 32'h0000_0000;

  // Offsets of the peripherals' registers.
  localparam logic [7:0] RegCycle = 8'h00;
  localparam logic [7:0] RegMark = 8'h04;
  localparam logic [7:0] RegConsole = 8'h08;
  localparam logic [7:0] RegDone = 8'h0c;
  localparam logic [7:0] RegLinkIn = 8'h10;
  localparam logic [7:0] RegLinkOut = 8'h14;
  localparam logic [7:0] RegDetBase = 8'h20;
  localparam logic [7:0] RegDetWidth = 8'h24;
  localparam logic [7:0] RegDetRing = 8'h28;
  localparam logic [7:0] RegDetRows = 8'h2c;
  localparam logic [7:0] RegDetTaken = 8'h30;
  localparam logic [7:0] RegDetControl = 8'h34;
  localparam logic [7:0] RegDacCode = 8'h40;
  localparam logic [7:0] RegDacLoad = 8'h44;
endpackage
