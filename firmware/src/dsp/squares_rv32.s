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
.macro upper floors, x, column
    signals {a}, {b}, \x, {raw}, \floors, {raw1}, \floors + 16
    add {odd}, {odd}, {b}
    add {f}, {a}, {b}
    signals {a}, {b}, \x, {raw2}, \floors + 32, {raw3}, \floors + 48
    add {odd}, {odd}, {b}
    add {a}, {a}, {b}
    add {pair}, {pair}, {a}
    add \column, {f}, {a}
.endm
// The same of the lower four, which count as the lower half besides; `f` has it of this column.
.macro lower floors, x
    signals {a}, {b}, \x, {raw}, \floors + 64, {raw1}, \floors + 80
    add {odd}, {odd}, {b}
    add {f}, {a}, {b}
    signals {a}, {b}, \x, {raw2}, \floors + 96, {raw3}, \floors + 112
    add {odd}, {odd}, {b}
    add {a}, {a}, {b}
    add {pair}, {pair}, {a}
.endm
// Looks at the watched pixels: `odd` has their peaks and `pair` how many are saturated.
.macro watch floors
    lw {k3}, 16({shared})
    lw {k2}, 12({shared})
    mul {open}, {open}, {k3}
    lw {a}, 8({raw1})
    lw {c}, \floors + 8({raw2})
    lw {b}, 12({raw1})
    lw {d}, \floors + 12({raw2})
    // Nothing was seen before the first word.
    sub {open}, {signs}, {open}
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
    // With its lane's top bit set, a signal less the first one keeps it where it is no less, and less one where it is
    // not zero.
    add {e}, {b}, {open}
    add {b}, {b}, {k2}
    sub {e}, {e}, {d}
    sub {d}, {e}, {odd}
    sub {e}, {e}, {k3}
    and {b}, {b}, {e}
    and {e}, {d}, {signs}
    and {b}, {b}, {signs}
    srli {b}, {b}, 15
    add {pair}, {pair}, {b}
    srli {b}, {e}, 15
    sub {e}, {e}, {b}
    and {d}, {d}, {e}
    add {odd}, {odd}, {d}
.endm

// The sums of the `i`-th window from where the pointers are, whose rows are from `raw` on.
.macro sums i
    rows
    signals {a}, {odd}, 0, {raw}, \i * 128, {raw1}, \i * 128 + 16
    add {f}, {a}, {odd}
    signals {a}, {b}, 0, {raw2}, \i * 128 + 32, {raw3}, \i * 128 + 48
    add {odd}, {odd}, {b}
    add {pair}, {a}, {b}
    add {k0}, {f}, {pair}
    upper \i * 128, 4, {k1}
    upper \i * 128, 8, {k2}
    upper \i * 128, 12, {k3}
    add {raw}, {raw3}, {stride}
    rows
    lower \i * 128, 0
    add {half}, {f}, {a}
    add {k0}, {k0}, {half}
    lower \i * 128, 4
    add {f}, {f}, {a}
    add {half}, {half}, {f}
    add {k1}, {k1}, {f}
    lower \i * 128, 8
    add {f}, {f}, {a}
    add {half}, {half}, {f}
    add {k2}, {k2}, {f}
    lower \i * 128, 12
    add {f}, {f}, {a}
    add {half}, {half}, {f}
    add {k3}, {k3}, {f}
    // Place times row from the bits of places: of second pixels in `b`, packed in `half`, of all in `half`. What is
    // above 32 bits of the upper halves is lost; `lower` takes the others away as well, and adds them to the lower.
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
    mul {e}, {b}, {lower}
    add {half}, {half}, {e}
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
    mul {e}, {b}, {lower}
    add {d}, {d}, {e}
    add {c}, {c}, {k0}
    mul {e}, {a}, {lower}
    add {c}, {c}, {e}
    // Half pixels: 4 word + 2 lane - 7, and 2 row - 7.
    sw {c}, \i * {windows} + {sum}({window})
    slli {d}, {d}, 1
    add {d}, {d}, {a}
    slli {d}, {d}, 1
    slli {e}, {c}, 3
    sub {e}, {e}, {c}
    sub {d}, {d}, {e}
    slli {half}, {half}, 1
    sub {half}, {half}, {e}
    sw {d}, \i * {windows} + {mx}({window})
    sw {half}, \i * {windows} + {my}({window})
.endm
