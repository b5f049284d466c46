// An actuator's height from its ratios.
.macro height h
    slli {t}, \h, 16
    and \h, \h, {upper}
    mulh {t}, {t}, {x}
    mulh \h, \h, {y}
    add {t}, {t}, {half}
    add \h, \h, {t}
    sra \h, \h, {bits}
    add \h, \h, {p}
.endm
// What is left above and below, and whether it is beyond.
.macro room h, up, down
    sub \up, \up, \h
    sub \down, \h, \down
    or {t}, \up, \down
    srli {t}, {t}, 31
    add {saturated}, {saturated}, {t}
.endm
// The smaller of two, to the first.
.macro smaller a, b
    sub \a, \a, \b
    srai {t}, \a, 31
    and \a, \a, {t}
    add \a, \a, \b
.endm
// A segment, so many bytes from where the pointers are. Loads stand apart from what needs them.
.macro segment node, applied, position, segment
    lhu {u}, \node({nodes})
    lw {a}, \segment({segments})
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
    sw {x}, \applied({applied})
    sw {y}, \applied + 4({applied})
    sw {x}, \position + 4({positions})
    sw {y}, \position + 8({positions})
    srai {p}, {p}, 1
    add {p}, {p}, {limit}
    lw {b}, \segment + 4({segments})
    lw {c}, \segment + 8({segments})
    slli {x}, {x}, {tilt_bits}
    slli {y}, {y}, {tilt_bits}
    height {a}
    height {b}
    height {c}
    lw {x}, \segment + {highest}({segments})
    lw {y}, \segment + {lowest}({segments})
    lw {u}, \segment + {highest} + 4({segments})
    lw {v}, \segment + {lowest} + 4({segments})
    // The least above and the least below, 0 at most: of a free mirror never both (see `reach`).
    room {a}, {x}, {y}
    room {b}, {u}, {v}
    srai {t}, {x}, 31
    and {x}, {x}, {t}
    smaller {x}, {u}
    smaller {y}, {v}
    lw {u}, \segment + {highest} + 8({segments})
    lw {v}, \segment + {lowest} + 8({segments})
    room {c}, {u}, {v}
    smaller {x}, {u}
    smaller {y}, {v}
    srai {t}, {y}, 31
    and {y}, {y}, {t}
    // The piston gives way.
    sub {x}, {x}, {y}
    add {p}, {p}, {x}
    add {a}, {a}, {x}
    add {b}, {b}, {x}
    add {c}, {c}, {x}
    sw {p}, \position({positions})
    sw {a}, \position({heights})
    sw {b}, \position + 4({heights})
    sw {c}, \position + 8({heights})
.endm

// Two segments a turn; of an odd number the first turn has one. Jumps to words' addresses: into the middle of
// one takes a cycle more.
.option push
.option norvc
.p2align 2
    bnez {x}, 3f
    j 4f
2:  addi {nodes}, {nodes}, 2 * {node}
    addi {segments}, {segments}, 2 * {segment}
    addi {applied}, {applied}, 16
    addi {positions}, {positions}, 24
    addi {heights}, {heights}, 24
    segment 0, 0, 0, 0
3:  segment {node}, 8, 12, {segment}
4:  bne {segments}, {end}, 2b
9:
.option pop
.purgem segment
.purgem smaller
.purgem room
.purgem height
