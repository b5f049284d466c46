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

.macro step
    addi {each}, {each}, 192
    addi {heights}, {heights}, 96
    addi {to}, {to}, 48
.endm

    turns {h}, {to}
.purgem turns
.purgem step
.purgem segment
.purgem actuator
