// An actuator's height at piston 0, of which the first ratio is in a register, from the second.
.macro tilted h, ratio
    lw {t}, \ratio({levers})
    mulh \h, \h, {x}
    mulh {t}, {t}, {y}
    add \h, \h, {t}
.endm
// How far the piston may go by an actuator's limit, as the piston is written.
.macro room limit, h
    sub \limit, \limit, \h
    xor \limit, \limit, {s}
.endm
// Whether the piston has gone beyond, to `t`, and to the actuators that have.
.macro beyond limit
    slt {t}, \limit, {p}
    add {saturated}, {saturated}, {t}
.endm
// The smaller of two, to the first.
.macro smaller a, b
    sub \a, \a, \b
    srai {t}, \a, 31
    and \a, \a, {t}
    add \a, \a, \b
.endm
// A segment, so many from where the pointers are. Loads stand apart from what needs them.
.macro segment i
    lhu {u}, {node} * (\i)({nodes})
    lw {a}, {lever} * (\i)({levers})
    bgeu {u}, {places}, 9f
    slli {u}, {u}, 3
    add {y}, {commands}, {u}
    add {u}, {unknowns}, {u}
    lw {p}, 0({u})
    lw {x}, 0({y})
    lw {y}, 4({y})
    // The piston without the mean, limited, and the command. What a red one's unknown is above a black one's.
    sltu {b}, {u}, {blacks}
    mul {b}, {b}, {room}
    add {p}, {p}, {raise}
    sub {p}, {p}, {b}
    sgtz {t}, {p}
    mul {p}, {p}, {t}
    sub {p}, {p}, {room}
    srai {t}, {p}, 31
    and {p}, {p}, {t}
    add {b}, {b}, {p}
    sw {b}, 0({u})
    srai {p}, {p}, 1
    add {p}, {p}, {limit}
    sw {x}, 8 * (\i)({applied})
    sw {y}, 8 * (\i) + 4({applied})
    sw {x}, 12 * (\i) + 4({positions})
    sw {y}, 12 * (\i) + 8({positions})
    sll {x}, {x}, {shift}
    sll {y}, {y}, {shift}
    lw {b}, {lever} * (\i) + 8({levers})
    lw {c}, {lever} * (\i) + 16({levers})
    tilted {a}, {lever} * (\i) + 4
    tilted {b}, {lever} * (\i) + 12
    tilted {c}, {lever} * (\i) + 20
    // Limits on the piston's side of flat. Below it is written as its complement, and so is what limits it: order
    // is reversed by that, and both sides have upper limits.
    srai {s}, {p}, 31
    andi {u}, {s}, {lowest} - {highest}
    add {u}, {u}, {segments}
    lw {x}, {segment} * (\i) + {highest}({u})
    lw {y}, {segment} * (\i) + {highest} + 4({u})
    lw {v}, {segment} * (\i) + {highest} + 8({u})
    room {x}, {a}
    room {y}, {b}
    room {v}, {c}
    xor {p}, {p}, {s}
    beyond {y}
    beyond {v}
    beyond {x}
    sub {x}, {x}, {p}
    mul {x}, {x}, {t}
    add {x}, {x}, {p}
    smaller {x}, {y}
    smaller {x}, {v}
    // The piston gives way.
    xor {p}, {x}, {s}
    add {a}, {a}, {p}
    add {b}, {b}, {p}
    add {c}, {c}, {p}
    sw {p}, 12 * (\i)({positions})
    sw {a}, 12 * (\i)({heights})
    sw {b}, 12 * (\i) + 4({heights})
    sw {c}, 12 * (\i) + 8({heights})
.endm

.macro step
    addi {nodes}, {nodes}, 8 * {node}
    addi {segments}, {segments}, 8 * {segment}
    addi {levers}, {levers}, 8 * {lever}
    addi {applied}, {applied}, 64
    addi {positions}, {positions}, 96
    addi {heights}, {heights}, 96
.endm

    turns {x}, {segments}
9:
.purgem turns
.purgem step
.purgem segment
.purgem smaller
.purgem beyond
.purgem room
.purgem tilted
