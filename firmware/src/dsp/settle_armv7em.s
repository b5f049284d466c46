// A command, `node` bytes from where the pointer is: the mean off, then the lower and the upper limit.
.macro place node
    ldr r4, [lr, #\node / 2]
    cbz r4, 99f
    ldrd r4, r5, [r8, #\node]
    sub r4, r0
    sub r5, r1
    bic r4, r4, r4, asr #31
    bic r5, r5, r5, asr #31
    sub r4, #{room}
    sub r5, #{room}
    and r4, r4, r4, asr #31
    and r5, r5, r5, asr #31
    add r4, #{limit}
    add r5, #{limit}
    strd r4, r5, [r8, #\node]
99:
.endm
.macro even node
    place \node
.endm
.macro odd node
    place \node
.endm
.macro step
.endm
.macro compare
    cmp r8, r2
.endm
