// The line of an actuator's v, to `x`: what it starts from and what it has risen by. The step's load has a load or a
// store behind it, that of the next height or of the code before.
.macro actuator i, x, between:vararg
    lw {s}, 8 * (\i) + 4({each})
    lw {v}, 8 * (\i)({each})
    mulh {h}, {h}, {s}
    add {v}, {v}, {h}
    slli {v}, {v}, {spare_bits}
    srli {v}, {v}, {spare_bits}
    srli {y}, {v}, {step_bits} - 2
    andi {y}, {y}, -4
    add {y}, {y}, {steps}
    lw {e}, 0({y})
    \between
    srl {y}, {v}, {e}
    slli {y}, {y}, 3
    add {y}, {y}, {e}
    lw \x, 1({y})
    lw {y}, -3({y})
    mulhu \x, \x, {v}
    add \x, \x, {y}
.endm
.macro segment i
    lw {h}, 12 * (\i)({heights})
    actuator 3 * (\i), {x}, lw {h}, 12 * (\i) + 4({heights})
    sh {x}, 6 * (\i)({to})
    actuator 3 * (\i) + 1, {w}, lw {h}, 12 * (\i) + 8({heights})
    actuator 3 * (\i) + 2, {x}, sh {w}, 6 * (\i) + 2({to})
    sh {x}, 6 * (\i) + 4({to})
.endm

// Eight segments a turn; the first turn has what is over. Jumps to words' addresses: into the middle of one takes a
// cycle more.
.option push
.option norvc
.p2align 2
    beqz {h}, 28f
.irp last, 27, 26, 25, 24, 23, 22
    addi {h}, {h}, -1
    beqz {h}, \last\()f
.endr
    j 21f
20: addi {each}, {each}, 192
    addi {heights}, {heights}, 96
    addi {to}, {to}, 48
    segment 0
21: segment 1
22: segment 2
23: segment 3
24: segment 4
25: segment 5
26: segment 6
27: segment 7
28: bne {to}, {end}, 20b
.option pop
.purgem segment
.purgem actuator
