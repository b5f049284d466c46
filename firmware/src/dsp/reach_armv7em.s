// On the stack: the nodes, the unknowns, the commands, where what the mirror shows is recorded, twice the mean less
// the pistons' room, how many places there are, what tilts are shifted by, and the end of the segments.
    push {{r6, r7}}
    sub sp, #32
    ldm r0!, {{r1-r4}}
    stm sp, {{r1-r4}}
    ldm r0, {{r1-r4}}
    add r0, sp, #16
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
    // Heights at piston 0.
    ldr r9, [sp, #24]
    lsl r1, r4, r9
    lsl r2, r5, r9
    ldm r10, {{r3-r5}}
    smulwb r6, r1, r3
    smlawt r3, r2, r3, r6
    smulwb r6, r1, r4
    smlawt r4, r2, r4, r6
    smulwb r6, r1, r5
    smlawt r5, r2, r5, r6
    // Limits on the piston's side of flat, less these. Below it all are written as their complements: order is reversed
    // by that, and both sides have upper limits.
    asr r1, r0, #31
    bic r2, r1, #{highest} - {lowest} - 1
    add r2, r10
    ldrd r6, r7, [r2, #{highest}]
    ldr r8, [r2, #{highest} + 8]
    sub r6, r3
    sub r7, r4
    sub r8, r5
    eor r6, r1
    eor r7, r1
    eor r8, r1
    eor r0, r1
    // What is left to them, and how many are beyond.
    sub r6, r0
    sub r7, r0
    sub r8, r0
    add lr, lr, r6, lsr #31
    add lr, lr, r7, lsr #31
    add lr, lr, r8, lsr #31
    // The least of it, 0 at most.
    and r6, r6, r6, asr #31
    sub r6, r7
    and r6, r6, r6, asr #31
    add r6, r7
    sub r6, r8
    and r6, r6, r6, asr #31
    add r6, r8
    // The piston gives way.
    add r6, r0
    eor r6, r1
    add r3, r6
    add r4, r6
    add r5, r6
    stm r12!, {{r3-r5}}
    str r6, [r11], #12
    add r10, #{segment}
    ldr r0, [sp, #28]
    cmp r10, r0
    bne 2b
9:  add sp, #32
    pop {{r6, r7}}
