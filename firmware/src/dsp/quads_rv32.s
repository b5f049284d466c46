// Steps have all their fraction bits.
.macro widen x
.endm
// A node of each row, `i` columns from where the pointers are, with `w0` to `w3` in their wests; `e0` to `e3`
// become the next ones' wests. Loads stand apart from what needs them.
.macro column i, w0, w1, w2, w3, e0, e1, e2, e3
    lw {k}, 8 * (\i)({each})
    lw {l}, 8 * (\i + {out})({each})
    lw \e0, 8 * (\i)({other})
    lw \e1, 8 * (\i + {out})({other})
    add {shared}, \w1, \e0
    beqz {k}, 90f
    lw {x}, 8 * (\i - {out})({other})
    add \w0, \w0, {shared}
    add {x}, {x}, \w0
    step \i, {k}
90: lw \e2, 8 * (\i + {out} + {back})({other})
    beqz {l}, 91f
    add {x}, \e1, {shared}
    add {x}, {x}, \e2
    step \i + {out}, {l}
91: lw {k}, 8 * (\i + {out} + {back})({each})
    lw \e3, 8 * (\i + 2 * {out} + {back})({other})
    lw {l}, 8 * (\i + 2 * {out} + {back})({each})
    add {shared}, \w3, \e2
    beqz {k}, 92f
    add {x}, \w1, \w2
    add {x}, {x}, {shared}
    step \i + {out} + {back}, {k}
92: beqz {l}, 93f
    lw {x}, 8 * (\i + 2 * {out} + 2 * {back})({other})
    add {shared}, {shared}, \e3
    add {x}, {x}, {shared}
    step \i + 2 * {out} + {back}, {l}
93:
.endm
.macro columns i
    column \i, {a0}, {a1}, {a2}, {a3}, {b0}, {b1}, {b2}, {b3}
    column \i + 1, {b0}, {b1}, {b2}, {b3}, {a0}, {a1}, {a2}, {a3}
.endm

// Jumps to words' addresses: into the middle of one takes a cycle more.
.option push
.option norvc
.p2align 2
2:  lw {a0}, -8({other})
    lw {a1}, 8 * ({out}) - 8({other})
    lw {a2}, 8 * ({out} + {back}) - 8({other})
    lw {a3}, 8 * (2 * {out} + {back}) - 8({other})
    columns 0
    columns 2
.if {stride} > 9
    columns 4
    columns 6
.endif
    addi {own}, {own}, 16 * {stride}
    addi {other}, {other}, 16 * {stride}
    addi {each}, {each}, 16 * {stride}
    bne {own}, {end}, 2b
.option pop
.purgem columns
.purgem column
.purgem step
.purgem take_step
.purgem widen
.purgem limit
