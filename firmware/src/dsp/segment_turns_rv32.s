// Eight segments a turn, of what `segment` does; `step` moves all pointers. The first turn has `over` segments, and the
// last one ends where `at` is the end. Jumps to words' addresses: into the middle of one takes a cycle more.
.macro turns over, at
.option push
.option norvc
.p2align 2
    beqz \over, 28f
.irp last, 27f, 26f, 25f, 24f, 23f, 22f
    addi \over, \over, -1
    beqz \over, \last
.endr
    j 21f
20: step
    segment 0
21: segment 1
22: segment 2
23: segment 3
24: segment 4
25: segment 5
26: segment 6
27: segment 7
28: bne \at, {end}, 20b
.option pop
.endm
