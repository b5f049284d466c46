// A right-hand side, `node` bytes from where the pointers of nodes are. `west` becomes its own; `east` is
// the next place's west.
.macro place node, west, east
    ldr r3, [lr, #\node + 4]
    ldr \east, [r9, #\node]
    cbz r3, 99f
    ldrd r4, r5, [r8, #\node]
    sub \west, \east
    // n_w - n_e, and n_n - n_s.
    sbfx r6, r3, #3, #2
    sbfx r3, r3, #5, #2
    mla \west, r4, r6, \west
    mla \west, r5, r3, \west
    ldr r4, [r10, #\node + 4]
    ldr r5, [r11, #\node + 4]
    add \west, r4
    sub \west, r5
    add \west, r7, \west, lsl #2
    str \west, [r12, #\node + 4]
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
    add r12, #32
    add lr, #16
.endm
.macro compare
    cmp r8, r2
.endm
    push {{r6, r7}}
    mov r7, r3
