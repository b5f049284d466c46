// The signals of two pixels, `x` bytes from the first ones of their rows, in `a` and `b`: less floor and excess, or zero.
// Loads stand apart from what needs them.
.macro signals a, b, x, row_a, floor_a, row_b, floor_b
    lhu \a, \x(\row_a)
    lhu {c}, \floor_a + \x({floor})
    lhu \b, \x(\row_b)
    lhu {d}, \floor_b + \x({floor})
    sub \a, \a, {c}
    sub \b, \b, {d}
    sub \a, \a, {open}
    sub \b, \b, {open}
    sgtz {c}, \a
    sgtz {d}, \b
    mul \a, \a, {c}
    mul \b, \b, {d}
.endm
// A column's pixels of the upper four rows, but for the first: what odd rows and the second pair have, to those sums;
// `k0` is the sum of columns so far, `k1` that of what it was after each.
.macro upper floors, x
    signals {a}, {b}, \x, {raw}, \floors, {raw1}, \floors + 16
    add {odd}, {odd}, {b}
    add {k0}, {k0}, {a}
    add {k0}, {k0}, {b}
    signals {a}, {b}, \x, {raw2}, \floors + 32, {raw3}, \floors + 48
    add {odd}, {odd}, {b}
    add {a}, {a}, {b}
    add {pair}, {pair}, {a}
    add {k0}, {k0}, {a}
    add {k1}, {k1}, {k0}
.endm
// The same of the lower four, with `half` for `k0`.
.macro lower floors, x
    signals {a}, {b}, \x, {raw}, \floors + 64, {raw1}, \floors + 80
    add {odd}, {odd}, {b}
    add {half}, {half}, {a}
    add {half}, {half}, {b}
    signals {a}, {b}, \x, {raw2}, \floors + 96, {raw3}, \floors + 112
    add {odd}, {odd}, {b}
    add {a}, {a}, {b}
    add {pair}, {pair}, {a}
    add {half}, {half}, {a}
    add {k1}, {k1}, {half}
.endm
// Looks at the watched pixels, two at a time: `odd` has their peak and `pair` how many are saturated.
.macro watch floors
    lw {k0}, 12({shared})
    li {odd}, 0
    li {pair}, 0
    .irp x, 8, 12
    lhu {a}, \x({raw1})
    lhu {c}, \floors + \x({raw2})
    lhu {b}, \x + 2({raw1})
    lhu {d}, \floors + \x + 2({raw2})
    sub {c}, {a}, {c}
    sub {d}, {b}, {d}
    sub {c}, {c}, {open}
    sub {d}, {d}, {open}
    sgtz {e}, {c}
    sgtz {f}, {d}
    slt {a}, {k0}, {a}
    slt {b}, {k0}, {b}
    and {a}, {a}, {e}
    and {b}, {b}, {f}
    add {pair}, {pair}, {a}
    add {pair}, {pair}, {b}
    sub {c}, {c}, {odd}
    sgtz {e}, {c}
    mul {c}, {c}, {e}
    add {odd}, {odd}, {c}
    sub {d}, {d}, {odd}
    sgtz {e}, {d}
    mul {d}, {d}, {e}
    add {odd}, {odd}, {d}
    .endr
.endm

// The sums of the `i`-th window from where the pointers are, whose rows are from `raw` on.
.macro sums i
    rows
    signals {k0}, {odd}, 0, {raw}, \i * 128, {raw1}, \i * 128 + 16
    add {k0}, {k0}, {odd}
    signals {a}, {b}, 0, {raw2}, \i * 128 + 32, {raw3}, \i * 128 + 48
    add {odd}, {odd}, {b}
    add {pair}, {a}, {b}
    add {k0}, {k0}, {pair}
    mv {k1}, {k0}
    .irp x, 2, 4, 6, 8, 10, 12, 14
    upper \i * 128, \x
    .endr
    add {raw}, {raw3}, {stride}
    rows
    li {half}, 0
    .irp x, 0, 2, 4, 6, 8, 10, 12, 14
    lower \i * 128, \x
    .endr
    // Place times row from the bits of places. Half pixels: 2 row - 7, and of the column at place x, which is 8 - x
    // times in `k1`, 9 - 2 (8 - x).
    add {c}, {k0}, {half}
    slli {half}, {half}, 1
    add {half}, {half}, {pair}
    slli {half}, {half}, 1
    add {half}, {half}, {odd}
    sw {c}, \i * {windows} + {sum}({window})
    slli {half}, {half}, 1
    slli {e}, {c}, 3
    sub {d}, {e}, {c}
    sub {half}, {half}, {d}
    add {e}, {e}, {c}
    slli {k1}, {k1}, 1
    sub {e}, {e}, {k1}
    sw {e}, \i * {windows} + {mx}({window})
    sw {half}, \i * {windows} + {my}({window})
.endm
