// The signals of a word each of two rows, in `a` and `b`: less floor and excess in their lanes where that leaves
// the top bit. Loads stand apart from what needs them.
.macro signals a, b, x, row_a, floor_a, row_b, floor_b
    lw \a, \x(\row_a)
    lw {c}, \floor_a + \x({floor})
    lw \b, \x(\row_b)
    lw {d}, \floor_b + \x({floor})
    add \a, \a, {open}
    add \b, \b, {open}
    sub \a, \a, {c}
    sub \b, \b, {d}
    and {c}, \a, {signs}
    and {d}, \b, {signs}
    srli {e}, {c}, 15
    sub {c}, {c}, {e}
    and \a, \a, {c}
    srli {e}, {d}, 15
    sub {d}, {d}, {e}
    and \b, \b, {d}
.endm
// The words of the upper four rows at one place of theirs, but for the first: what odd rows and the second pair
// have, to those sums; all begin the column's.
.macro upper x, column
    signals {a}, {b}, \x, {raw}, 0, {raw1}, 16
    add {odd}, {odd}, {b}
    add {f}, {a}, {b}
    signals {a}, {b}, \x, {raw2}, 32, {raw3}, 48
    add {odd}, {odd}, {b}
    add {a}, {a}, {b}
    add {pair}, {pair}, {a}
    add \column, {f}, {a}
.endm
// The same of the lower four, which count as the lower half besides; `f` has it of this column.
.macro lower x
    signals {a}, {b}, \x, {raw}, 64, {raw1}, 80
    add {odd}, {odd}, {b}
    add {f}, {a}, {b}
    signals {a}, {b}, \x, {raw2}, 96, {raw3}, 112
    add {odd}, {odd}, {b}
    add {a}, {a}, {b}
    add {pair}, {pair}, {a}
.endm
// Looks at a word of the watched row, before `odd` has the rows' sum its peak, `pair` how many are saturated, `k2`
// and `k3` what takes a saturated pixel to its lane's top bit and ones. With that bit set, a signal less the peak so
// far keeps it where it is no less, and less one where it is not zero.
.macro note word, floor
    add {e}, \word, {open}
    add \word, \word, {k2}
    sub {e}, {e}, \floor
    sub \floor, {e}, {odd}
    sub {e}, {e}, {k3}
    and \word, \word, {e}
    and {e}, \floor, {signs}
    and \word, \word, {signs}
    srli \word, \word, 15
    add {pair}, {pair}, \word
    srli \word, {e}, 15
    sub {e}, {e}, \word
    and \floor, \floor, {e}
    add {odd}, {odd}, \floor
.endm

// A window. Its first pixel, in bytes from that of the rows.
.p2align 2
2:  lhu {b}, {y0}({slot})
    lw {stride}, 0({shared})
    lhu {a}, {x0}({slot})
    lw {c}, 4({shared})
    mul {b}, {b}, {stride}
    lw {d}, 8({shared})
    slli {a}, {a}, 1
    add {a}, {a}, {c}
    add {a}, {a}, {b}
    andi {b}, {a}, 2
    bnez {b}, 9f
    bltu {d}, {a}, 9f
    lw {c}, 12({shared})
    lhu {open}, {excess}({tracking})
    lbu {e}, {watched}({tracking})
    lw {f}, 16({shared})
    add {raw}, {a}, {c}
    andi {e}, {e}, 7
    mul {a}, {e}, {stride}
    slli {e}, {e}, 4
    mul {open}, {open}, {f}
    add {raw2}, {floor}, {e}
    add {raw1}, {raw}, {a}
    add {open}, {open}, {signs}
    // The watched row, at `raw1` with its floors at `raw2`. Nothing was seen before its first word.
    lw {k2}, 20({shared})
    lw {k3}, 24({shared})
    lw {a}, 0({raw1})
    lw {c}, 0({raw2})
    lw {b}, 4({raw1})
    lw {d}, 4({raw2})
    add {e}, {a}, {open}
    add {a}, {a}, {k2}
    sub {e}, {e}, {c}
    sub {c}, {e}, {k3}
    and {a}, {a}, {c}
    and {c}, {e}, {signs}
    and {a}, {a}, {signs}
    srli {pair}, {a}, 15
    srli {a}, {c}, 15
    sub {c}, {c}, {a}
    and {odd}, {e}, {c}
    note {b}, {d}
    lw {a}, 8({raw1})
    lw {c}, 8({raw2})
    lw {b}, 12({raw1})
    lw {d}, 12({raw2})
    note {a}, {c}
    note {b}, {d}
    sw {odd}, {seen_peak}({window})
    sw {pair}, {seen_saturated}({window})
    // All rows.
    add {raw1}, {raw}, {stride}
    add {raw2}, {raw1}, {stride}
    add {raw3}, {raw2}, {stride}
    slli {stride}, {stride}, 2
    signals {a}, {odd}, 0, {raw}, 0, {raw1}, 16
    add {f}, {a}, {odd}
    signals {a}, {b}, 0, {raw2}, 32, {raw3}, 48
    add {odd}, {odd}, {b}
    add {pair}, {a}, {b}
    add {k0}, {f}, {pair}
    upper 4, {k1}
    upper 8, {k2}
    upper 12, {k3}
    add {raw}, {raw}, {stride}
    add {raw1}, {raw1}, {stride}
    add {raw2}, {raw2}, {stride}
    add {raw3}, {raw3}, {stride}
    lower 0
    add {half}, {f}, {a}
    add {k0}, {k0}, {half}
    lower 4
    add {f}, {f}, {a}
    add {half}, {half}, {f}
    add {k1}, {k1}, {f}
    lower 8
    add {f}, {f}, {a}
    add {half}, {half}, {f}
    add {k2}, {k2}, {f}
    lower 12
    add {f}, {f}, {a}
    add {half}, {half}, {f}
    add {k3}, {k3}, {f}
    // Place times row from the bits of places: of second pixels in `b`, packed in `half`, of all in `half`.
    srli {e}, {odd}, 16
    srli {f}, {pair}, 16
    srli {b}, {half}, 16
    slli {b}, {b}, 1
    add {b}, {b}, {f}
    slli {b}, {b}, 1
    add {b}, {b}, {e}
    slli {half}, {half}, 1
    add {half}, {half}, {pair}
    slli {half}, {half}, 1
    add {half}, {half}, {odd}
    slli {e}, {b}, 16
    sub {half}, {half}, {e}
    add {half}, {half}, {b}
    // Columns from right to left. Of second pixels, `a` has the sum so far and `b` that of what it was after each,
    // which adds up to place times column; `c` and `d` have the same of packed ones.
    srli {a}, {k3}, 16
    srli {e}, {k2}, 16
    add {e}, {e}, {a}
    add {b}, {a}, {e}
    add {c}, {k3}, {k2}
    add {d}, {k3}, {c}
    srli {a}, {k1}, 16
    add {a}, {a}, {e}
    add {b}, {b}, {a}
    add {c}, {c}, {k1}
    add {d}, {d}, {c}
    srli {e}, {k0}, 16
    add {a}, {a}, {e}
    // Without what is above 32 bits of the upper halves the packed sums are those over lower halves.
    slli {e}, {b}, 16
    sub {d}, {d}, {e}
    add {d}, {d}, {b}
    add {c}, {c}, {k0}
    slli {e}, {a}, 16
    sub {c}, {c}, {e}
    add {c}, {c}, {a}
    // Half pixels: 4 word + 2 lane - 7, and 2 row - 7.
    sw {c}, {sum}({window})
    slli {d}, {d}, 1
    add {d}, {d}, {a}
    slli {d}, {d}, 1
    slli {e}, {c}, 3
    sub {e}, {e}, {c}
    sub {d}, {d}, {e}
    slli {half}, {half}, 1
    sub {half}, {half}, {e}
    sw {d}, {mx}({window})
    sw {half}, {my}({window})
    lw {a}, 28({shared})
    addi {slot}, {slot}, {slots}
    addi {tracking}, {tracking}, {trackings}
    addi {floor}, {floor}, 128
    addi {window}, {window}, {windows}
    bne {window}, {a}, 2b
9:
.purgem signals
.purgem upper
.purgem lower
.purgem note
