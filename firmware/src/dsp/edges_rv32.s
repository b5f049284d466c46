// A right-hand side, `node` bytes from where the pointers of nodes are. `west` becomes its own; `east` is
// the next place's west. Loads stand apart from what needs them.
.macro place node, west, east
    lw {k}, \node + 4({each})
    lw \east, \node({east})
    beqz {k}, 99f
    lw {n}, \node + 4({north})
    lw {s}, \node + 4({south})
    sub \west, \west, \east
    andi {t}, {k}, 0x78
    sub {n}, {n}, {s}
    add \west, \west, {n}
    // Its own count where its neighbours are not the same on both sides: at the mask's edge.
    beqz {t}, 98f
    lw {x}, \node({own})
    lw {y}, \node + 4({own})
    // n_w - n_e, and n_n - n_s.
    slli {t}, {k}, 27
    srai {t}, {t}, 30
    slli {k}, {k}, 25
    srai {k}, {k}, 30
    mul {t}, {t}, {x}
    mul {k}, {k}, {y}
    add {t}, {t}, {k}
    add \west, \west, {t}
98: slli \west, \west, 1
    add \west, \west, {offset}
    sw \west, \node + 4({to})
99:
.endm
.macro step
    addi {to}, {to}, 64
.endm
