// On the stack: the nodes, the unknowns, the commands, where what the mirror shows is recorded, twice the mean less
// the pistons' room, how
// many places there are, the ratios' half and bits, and the end of the segments.
    push {{r6, r7}}
    sub sp, #40
    ldm r0!, {{r1-r5}}
    stm sp, {{r1-r5}}
    ldm r0, {{r1-r4}}
    add r0, sp, #20
    stm r0, {{r1-r4}}
2:  ldm sp, {{r0-r4, r6}}
    ldrh r5, [r0], #6
    cmp r5, r6
    bhs 9f
    // The piston without the mean, limited, and the command. What a red one's unknown is above a black one's.
    ldr r6, [r1, r5, lsl #3]
    subw r7, r5, #{blacks}
    asr r7, #31
    and r7, #{room}
    sub r6, r4
    sub r6, r7
    bic r6, r6, r6, asr #31
    sub r6, #{room}
    and r6, r6, r6, asr #31
    add r7, r6
    str r7, [r1, r5, lsl #3]
    add r2, r2, r5, lsl #3
    ldrd r4, r5, [r2]
    strd r4, r5, [r3], #8
    strd r4, r5, [r11, #4]
    str r0, [sp]
    str r3, [sp, #12]
    asr r0, r6, #1
    add r0, #{limit}
    str r0, [r11]
    // Heights.
    lsl r1, r4, #{tilt_bits}
    lsl r2, r5, #{tilt_bits}
    ldm r10, {{r3-r5}}
    ldrd r7, r8, [sp, #24]
    smlawb r6, r1, r3, r7
    smlawt r3, r2, r3, r6
    smlawb r6, r1, r4, r7
    smlawt r4, r2, r4, r6
    smlawb r6, r1, r5, r7
    smlawt r5, r2, r5, r6
    asr r3, r8
    asr r4, r8
    asr r5, r8
    add r3, r0
    add r4, r0
    add r5, r0
    // What is left below and above, and how many are beyond.
    ldrd r1, r2, [r10, #{lowest}]
    ldr r6, [r10, #{lowest} + 8]
    ldrd r7, r8, [r10, #{highest}]
    ldr r9, [r10, #{highest} + 8]
    sub r1, r3, r1
    sub r2, r4, r2
    sub r6, r5, r6
    sub r7, r3
    sub r8, r4
    sub r9, r5
    orr r0, r1, r7
    add lr, lr, r0, lsr #31
    orr r0, r2, r8
    add lr, lr, r0, lsr #31
    orr r0, r6, r9
    add lr, lr, r0, lsr #31
    // The least above and the least below, 0 at most: of a free mirror never both (see `reach`).
    and r7, r7, r7, asr #31
    sub r7, r8
    and r7, r7, r7, asr #31
    add r7, r8
    sub r7, r9
    and r7, r7, r7, asr #31
    add r7, r9
    sub r1, r2
    and r1, r1, r1, asr #31
    add r1, r2
    sub r1, r6
    and r1, r1, r1, asr #31
    add r1, r6
    and r1, r1, r1, asr #31
    // The piston gives way.
    sub r7, r1
    add r3, r7
    add r4, r7
    add r5, r7
    stm r12!, {{r3-r5}}
    ldr r0, [r11]
    add r0, r7
    str r0, [r11], #12
    add r10, #{segment}
    ldr r0, [sp, #32]
    cmp r10, r0
    bne 2b
9:  add sp, #40
    pop {{r6, r7}}
