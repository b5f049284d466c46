// A code: v of the height, 0 at least.
.macro actuator i
    lw {h}, 4 * (\i)({heights})
    lw {x}, 8 * (\i) + 4({each})
    lw {v}, 8 * (\i)({each})
.if {is_short}
    slli {h}, {h}, 6
    slli {x}, {x}, 5
    mulhsu {y}, {h}, {x}
.else
    mulh {y}, {x}, {h}
    mul {x}, {x}, {h}
    slli {y}, {y}, 11
    srli {x}, {x}, 21
    add {v}, {v}, {x}
.endif
    add {v}, {v}, {y}
.if 1 - {is_short}
    sgtz {x}, {v}
    mul {v}, {v}, {x}
.endif
    // Twice that, shifted to its top nibble: by 12 bits or not, and by what its highest byte says.
    sltu {h}, {v}, {small}
    mul {h}, {h}, {twelve}
    sll {x}, {v}, {h}
    srli {y}, {x}, 23
    add {y}, {y}, {shifts}
    lbu {y}, 0({y})
    slli {v}, {v}, 1
    sll {x}, {x}, {y}
    add {h}, {h}, {y}
    // The line of its cell.
    srli {y}, {x}, 23
    slli {y}, {y}, 2
    add {y}, {y}, {roots}
    lw {y}, 0({y})
    srli {x}, {x}, 11
    srli {h}, {h}, 1
    and {w}, {y}, {rise}
    mul {x}, {x}, {w}
    add {x}, {x}, {y}
    srl {x}, {x}, {h}
    // Rounded down it is the root or one less.
    addi {y}, {x}, 1
    mul {y}, {y}, {x}
    sltu {y}, {y}, {v}
    add {x}, {x}, {y}
    sh {x}, 2 * (\i)({to})
.endm
.macro segment first
    actuator \first
    actuator \first + 1
    actuator \first + 2
.endm

// Two segments a turn; of an odd number the first turn has one. Jumps to words' addresses: into the middle of
// one takes a cycle more.
.option push
.option norvc
.p2align 2
    bnez {h}, 3f
    j 4f
2:  addi {each}, {each}, 48
    addi {heights}, {heights}, 24
    addi {to}, {to}, 12
    segment 0
3:  segment 3
4:  bne {to}, {end}, 2b
.option pop
.purgem segment
.purgem actuator
