// The `i`-th spot from where the pointers are. Loads stand apart from what needs them.
.macro spot i
    lw {d}, \i * {window} + {sum}({from})
    lw {x}, \i * {window} + {mx}({from})
    lw {y}, \i * {window} + {my}({from})
    // Its leading zeros but 6, in `s`: by 9 and 9 bits, and by what the highest nine of the others say. Of a small
    // one, by 9, and by what the highest nine below the next 8 say.
.if {small}
    sltiu {t}, {d}, 512
    slli {s}, {t}, 3
    add {s}, {s}, {t}
    slli {u}, {d}, 6
    sll {u}, {u}, {s}
    srli {t}, {u}, 15
    andi {t}, {t}, 511
.else
    srli {t}, {d}, 17
    seqz {t}, {t}
    sltiu {u}, {d}, 256
    add {t}, {t}, {u}
    slli {s}, {t}, 3
    add {s}, {s}, {t}
    slli {u}, {d}, 6
    sll {u}, {u}, {s}
    srli {t}, {u}, 23
.endif
    add {t}, {t}, {zeros}
    lbu {t}, 0({t})
    lhu {z}, \i * {window} + {peak}({from})
    sll {u}, {u}, {t}
    add {s}, {s}, {t}
    // Its inverse, in `p`: the chord of its cell.
    slli {t}, {u}, 1
    srli {t}, {t}, 20
    andi {t}, {t}, -8
    add {t}, {t}, {inverses}
    lw {p}, 0({t})
    lw {t}, 4({t})
    slli {u}, {u}, 10
    sll {x}, {x}, {s}
    mulhu {t}, {t}, {u}
    sll {y}, {y}, {s}
    sub {p}, {p}, {t}
    // The centroid.
    mulh {x}, {x}, {p}
    mulh {y}, {y}, {p}
    lhu {s}, \i * {window} + {peak} + 2({from})
    sw {x}, \i * {measurement}({at})
    sw {y}, \i * {measurement} + 4({at})
    sw {d}, \i * {measurement} + {flux}({at})
    // The peak of both lanes, and what was taken off one.
    lhu {u}, \i * {window} + {white}({from})
    lhu {q}, \i * {window} + {white} + 2({from})
    sub {s}, {z}, {s}
    srai {p}, {s}, 31
    and {s}, {s}, {p}
    lhu {p}, \i * {tracking} + {excess}({done})
    sub {t}, {z}, {s}
    snez {s}, {t}
    mul {s}, {s}, {p}
    add {u}, {u}, {q}
    lw {q}, \i * {limit} + {threshold}({limits})
    sh {u}, \i * {measurement} + {saturated}({at})
    add {saturated_sum}, {saturated_sum}, {u}
    add {t}, {t}, {s}
    sh {t}, \i * {measurement} + {highest}({at})
    // What the next moving threshold has beyond the fixed one.
    lw {p}, 8({shared})
.if {low}
    lw {u}, \i * {limit} + {gain}({limits})
    mul {t}, {t}, {p}
    add {t}, {t}, {q}
    srai {t}, {t}, 16
.else
    lw {u}, 4({shared})
    add {t}, {t}, {q}
    srli {s}, {t}, 16
    neg {s}, {s}
    or {t}, {t}, {s}
    and {t}, {t}, {u}
    lw {u}, \i * {limit} + {gain}({limits})
    mul {t}, {t}, {p}
    lui {s}, 8
    add {t}, {t}, {s}
    srli {t}, {t}, 16
    sub {t}, {t}, {q}
.endif
    sgtz {s}, {t}
    mul {t}, {t}, {s}
    sh {t}, \i * {tracking} + {excess}({next})
    // The pixel nearest the centroid; without flux that is in the middle.
    srai {t}, {x}, 16
    srai {s}, {y}, 16
    sb {t}, \i * {tracking} + {near}({next})
    sb {s}, \i * {tracking} + {near} + 1({next})
    // The slope: products' upper halves.
    lw {t}, \i * {calibration} + {reference}({cal})
    lw {s}, \i * {calibration} + {reference} + 4({cal})
    lw {p}, \i * {limit} + {gain} + 4({limits})
    lw {q}, \i * {limit} + {gain} + 8({limits})
    lw {z}, \i * {limit} + {gain} + 12({limits})
    sub {x}, {x}, {t}
    sub {y}, {y}, {s}
    slli {x}, {x}, {headroom}
    slli {y}, {y}, {headroom}
    mulh {t}, {u}, {x}
    mulh {p}, {p}, {y}
    mulh {s}, {q}, {x}
    mulh {z}, {z}, {y}
    lw {x}, \i * {calibration} + {flux_min}({cal})
    lw {y}, \i * {limit} + {flux_span}({limits})
    add {t}, {t}, {p}
    add {s}, {s}, {z}
    sw {t}, \i * {slope} + {tilt}({to})
    sw {s}, \i * {slope} + {tilt} + 4({to})
    // Whether the flux is within its limits.
    sub {x}, {d}, {x}
    sltu {x}, {x}, {y}
    lw {p}, \i * 8({applied})
    lw {q}, \i * 8 + 4({applied})
    lw {z}, \i * {limit} + {place}({limits})
    sb {x}, \i * {slope} + {valid}({to})
    add {count}, {count}, {x}
    // What a flat mirror would have shown, and its place.
    add {t}, {t}, {p}
    add {s}, {s}, {q}
    mul {t}, {t}, {x}
    mul {s}, {s}, {x}
    add {sum_x}, {sum_x}, {t}
    add {sum_y}, {sum_y}, {s}
    add {z}, {z}, {open_loop}
    slli {t}, {t}, {guard}
    or {t}, {t}, {x}
    slli {s}, {s}, {guard}
    sw {t}, 0({z})
    sw {s}, 4({z})
.endm

// Four a turn; the first one is entered behind `t` of them. Jumps to words' addresses: into the middle of one takes a
// cycle more.
    beqz {t}, 3f
    addi {t}, {t}, -2
    bltz {t}, 11f
    beqz {t}, 12f
    j 13f
.p2align 2
3:  spot 0
.p2align 2
11: spot 1
.p2align 2
12: spot 2
.p2align 2
13: spot 3
    lw {t}, 0({shared})
    addi {from}, {from}, 4 * {window}
    addi {at}, {at}, 4 * {measurement}
    addi {done}, {done}, 4 * {tracking}
    addi {next}, {next}, 4 * {tracking}
    addi {limits}, {limits}, 4 * {limit}
    addi {cal}, {cal}, 4 * {calibration}
    addi {applied}, {applied}, 32
    addi {to}, {to}, 4 * {slope}
    bne {from}, {t}, 3b
.purgem spot
