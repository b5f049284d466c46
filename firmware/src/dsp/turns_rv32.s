// Four places a turn, of what `even` and `odd` do; `step` moves what pointers there are beside these. The
// first turn is entered behind `x` places. Jumps to words' addresses: into the middle of one takes a
// cycle more.
.option push
.option norvc
.p2align 2
    addi {x}, {x}, -2
    bltz {x}, 11f
    beqz {x}, 12f
    addi {x}, {x}, -1
    beqz {x}, 13f
    j 14f
3:  addi {each}, {each}, 16
    addi {own}, {own}, 32
    step
    even 0
11: odd 8
12: even 16
13: odd 24
14: bne {own}, {end}, 3b
.option pop
.purgem place
.purgem even
.purgem odd
.purgem step
