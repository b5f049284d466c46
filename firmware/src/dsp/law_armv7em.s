// A place, `node` bytes from where the pointers of nodes are. On the stack: the inverses' address and the
// end, 8 times the means, both sums.
.macro place node
    ldr r0, [lr, #\node / 2]
    lsls r5, r0, #16
    beq 99f
    // 8 x of the neighbours, and how many were measured.
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
    // Their weight, unless it was measured itself.
    ldr r4, [sp]
    and r3, r1, #7
    ldr r3, [r4, r3, lsl #2]
    ands r4, r6, #1
    it ne
    movne r3, #0
    bic r1, #7
    bic r6, #7
    smmul r1, r1, r3
    smmul r2, r2, r3
    // 8 x, less its mean.
    add r1, r6, r1, lsl #3
    add r2, r7, r2, lsl #3
    ldrd r6, r7, [sp, #8]
    sub r1, r6
    sub r2, r7
    // Where it is not known nothing changes.
    orr r3, r4
    rsb r3, #0
    and r5, r5, r3, asr #31
    and r0, r0, r3, asr #31
    bfc r0, #0, #16
    // c and a half plus 2^19 (drop c + take x) / 2^32.
    ldr r6, [r12, #\node]
    mov r3, #0x80000000
    lsl r7, r6, #3
    smlal r3, r6, r5, r7
    smlal r3, r6, r0, r1
    ldr r7, [r12, #\node + 4]
    mov r3, #0x80000000
    lsl r1, r7, #3
    smlal r3, r7, r5, r1
    smlal r3, r7, r0, r2
    strd r6, r7, [r12, #\node]
    // The sums of those that were measured.
    ldrd r0, r1, [sp, #16]
    ldrd r2, r3, [sp, #24]
    smlal r0, r1, r6, r4
    smlal r2, r3, r7, r4
    strd r0, r1, [sp, #16]
    strd r2, r3, [sp, #24]
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
    mov r6, #0
    mov r7, #0
    strd r6, r7, [sp, #-8]!
    strd r6, r7, [sp, #-8]!
    strd r0, r1, [sp, #-8]!
    strd r2, r3, [sp, #-8]!
