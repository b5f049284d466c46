// A place, `node` bytes from where the pointers of nodes are. On the stack: the inverses' address and the
// end, 16 times the means.
.macro place node
    ldr r0, [lr, #\node / 2]
    cmp r0, #0
    beq 99f
    // 16 x of the neighbours, and how many were measured.
    ldrd r1, r2, [r9, #\node - 8]
    ldrd r3, r4, [r9, #\node]
    add r1, r3
    add r2, r4
    ldrd r3, r4, [r10, #\node]
    add r1, r3
    add r2, r4
    ldrd r3, r4, [r11, #\node]
    add r1, r3
    add r2, r4
    ldrd r6, r7, [r8, #\node]
    // Where x is not known it holds.
    add r4, r1, r6, lsl #3
    ands r4, r4, #15
    ldrd r3, r5, [sp, #8]
    sub r6, r3
    sub r7, r5
    ldr r3, [sp]
    ldr r3, [r3, r4, lsl #2]
    ite ne
    movne r4, #1
    moveq r0, #0
    add r0, #{hold}
    // x less its mean; of the neighbours, unless it was measured itself.
    mov r5, #0
    smlal r5, r6, r1, r3
    smlal r5, r6, r1, r3
    mov r5, #0
    smlal r5, r7, r2, r3
    smlal r5, r7, r2, r3
    // keep c + take x, each rounded down, and 1.
    ldrd r2, r3, [r12, #\node]
    lsl r1, r0, #17
    bfc r0, #0, #15
    lsl r2, #2
    lsl r3, #2
    smmla r2, r2, r1, r4
    smmla r3, r3, r1, r4
    smmla r2, r6, r0, r2
    smmla r3, r7, r0, r3
    ssat r2, #24, r2
    ssat r3, #24, r3
    strd r2, r3, [r12, #\node]
99:
.endm

.macro even node
    place \node
.endm
.macro odd node
    place \node
.endm
.macro step
    add r9, #32
    add r10, #32
    add r11, #32
    add r12, #32
.endm
.macro compare
    ldr r0, [sp, #4]
    cmp r8, r0
.endm
    push {{r6, r7}}
    strd r0, r1, [sp, #-8]!
    strd r2, r3, [sp, #-8]!
