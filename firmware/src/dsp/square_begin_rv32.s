// The first pixel of the `i`-th window from where the pointers are, at `raw`, and what is taken off its pixels besides
// floors, in `open`; `out` is where it goes from one that is not to be taken. The watched pixels are 8 bytes from
// `raw1` on, their floors as much and `i` windows from `raw2` on.
.macro begin i, out
    // In bytes from that of the rows.
    lw {a}, \i * 4({start})
    lw {c}, 0({shared})
    lw {d}, 4({shared})
    lb {e}, \i * {trackings} + {near} + 1({tracking})
    add {a}, {a}, {c}
    bltu {d}, {a}, \out
    lw {c}, 8({shared})
    lhu {open}, \i * {trackings} + {excess}({tracking})
    lb {f}, \i * {trackings} + {near}({tracking})
    add {raw}, {a}, {c}
    // The watched row, 0 to 7, and the first of two words of that, here 2 less it: where column `near` is the second
    // or third one of.
    addi {e}, {e}, 4
    andi {e}, {e}, 7
    mul {a}, {e}, {stride}
    slli {e}, {e}, 4
    slti {b}, {f}, -1
    slti {c}, {f}, 1
    add {b}, {b}, {c}
    slli {b}, {b}, 2
    sub {e}, {e}, {b}
    sub {a}, {a}, {b}
    add {raw2}, {floor}, {e}
    add {raw1}, {raw}, {a}
.endm
// Rows from `raw` on.
.macro rows
    add {raw1}, {raw}, {stride}
    add {raw2}, {raw1}, {stride}
    add {raw3}, {raw2}, {stride}
.endm
// A window: what its watched pixels show, which `watch` leaves in `odd` and `pair`, then its sums.
.macro square i, out
    begin \i, \out
    watch \i * 128
    sw {odd}, \i * {windows} + {seen_peak}({window})
    sw {pair}, \i * {windows} + {seen_saturated}({window})
    sums \i
.endm
