// A place, `node` bytes from where the pointers of nodes are. `west` becomes its own; `east` is the next
// place's west. Loads stand apart from what needs them.
.macro place node, west_x, west_y, east_x, east_y
    lh {take}, \node / 2 + 2({each})
    lw \east_x, \node({east})
    lw \east_y, \node + 4({east})
    beqz {take}, 99f
    lw {p}, \node({north})
    lw {q}, \node({south})
    lw {c}, \node + 4({north})
    lw {d}, \node + 4({south})
    lw {x}, \node({own})
    lw {y}, \node + 4({own})
    // 8 x of the neighbours, and how many were measured.
    add \west_x, \west_x, \east_x
    add {p}, {p}, {q}
    add \west_x, \west_x, {p}
    andi {p}, \west_x, 7
    slli {p}, {p}, 2
    add {p}, {p}, {inverses}
    lw {p}, 0({p})
    add \west_y, \west_y, \east_y
    add {c}, {c}, {d}
    add \west_y, \west_y, {c}
    // Their weight, unless it was measured itself.
    andi {valid}, {x}, 1
    addi {q}, {valid}, -1
    and {p}, {p}, {q}
    andi \west_x, \west_x, -8
    mulh \west_x, \west_x, {p}
    mulh \west_y, \west_y, {p}
    srai {x}, {x}, 3
    srai {y}, {y}, 3
    sub {x}, {x}, {mean_x}
    sub {y}, {y}, {mean_y}
    add {x}, {x}, \west_x
    add {y}, {y}, \west_y
    // Where x is not known nothing changes.
    lh \west_x, \node / 2({each})
    lw {c}, \node({to})
    lw {d}, \node + 4({to})
    or {p}, {p}, {valid}
    neg {p}, {p}
    srai {p}, {p}, 31
    and \west_x, \west_x, {p}
    and {take}, {take}, {p}
    change {c}, {x}, \west_x, \west_y
    sw {c}, \node({to})
    change {d}, {y}, \west_x, \west_y
    sw {d}, \node + 4({to})
    // The sums of those that were measured: all of them, and that without the lowest bits.
    neg {valid}, {valid}
    and {c}, {c}, {valid}
    and {d}, {d}, {valid}
    add {low_c}, {low_c}, {c}
    add {low_d}, {low_d}, {d}
    srai {c}, {c}, 14
    srai {d}, {d}, 14
    add {high_c}, {high_c}, {c}
    add {high_d}, {high_d}, {d}
99:
.endm

// `c` plus (drop c + take x) / 2^13, rounded. The upper parts of c and x need no rounding; what the
// product has beside theirs fits 32 bits, so that it is known from its own lower ones.
.macro change c, x, drop, t
    srai {p}, \c, 13
    srai {q}, \x, 13
    mul {p}, {p}, \drop
    mul {q}, {q}, {take}
    mul \t, \c, \drop
    mul \x, \x, {take}
    add {p}, {p}, {q}
    add \t, \t, \x
    slli {q}, {p}, 13
    add \t, \t, {half}
    sub \t, \t, {q}
    srai \t, \t, 13
    add \c, \c, {p}
    add \c, \c, \t
.endm

.macro even node
    place \node, {ax}, {ay}, {bx}, {by}
.endm
.macro odd node
    place \node, {bx}, {by}, {ax}, {ay}
.endm
.macro step
    addi {east}, {east}, 32
    addi {north}, {north}, 32
    addi {south}, {south}, 32
    addi {to}, {to}, 32
.endm
