// A place, `node` bytes from where the pointers of nodes are. `west` becomes its own; `east` is the next
// place's west. The end is on the stack.
.macro place node, west, east
    ldr r4, [lr, #\node + 4]
    ldr \east, [r9, #\node]
    cbz r4, 99f
    ldrd r6, r7, [r8, #\node]
    // 2 r.
    and r4, #7
    add \west, \east
    mls \west, r6, r4, \west
    ldr r4, [r10, #\node]
    add \west, r4
    ldr r4, [r11, #\node]
    add \west, r4
    add \west, \west, r7, asr #1
    // The square of r / 8, and u: all of it, and that without the lowest bits.
    asr \west, #4
    smlal r2, r3, \west, \west
    add r5, r6
    add r12, r12, r6, asr #14
99:
.endm
.macro even node
    place \node, r0, r1
.endm
.macro odd node
    place \node, r1, r0
.endm
.macro step
    add r9, #32
    add r10, #32
    add r11, #32
    add lr, #16
.endm
.macro compare
    ldr r4, [sp]
    cmp r8, r4
.endm
    push {{r6, r7}}
    str r5, [sp, #-8]!
    mov r5, #0
