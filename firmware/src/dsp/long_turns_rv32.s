// Eight places a turn, of what `even` and `odd` do; `step` moves what pointers there are beside these. The
// first turn is entered behind `x` places. Jumps to words' addresses: into the middle of one takes a
// cycle more.
.option push
.option norvc
.p2align 2
    addi {x}, {x}, -4
    beqz {x}, 14f
    bgtz {x}, 2f
    addi {x}, {x}, 2
    bltz {x}, 11f
    beqz {x}, 12f
    j 13f
2:  addi {x}, {x}, -2
    bltz {x}, 15f
    beqz {x}, 16f
    addi {x}, {x}, -2
    bltz {x}, 17f
    j 18f
3:  addi {each}, {each}, 64
    addi {own}, {own}, 64
    step
    even 0
11: odd 8
12: even 16
13: odd 24
14: even 32
15: odd 40
16: even 48
17: odd 56
18: bne {own}, {end}, 3b
.option pop
.purgem place
.purgem even
.purgem odd
.purgem step
