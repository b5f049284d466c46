// Eight places a turn, with two registers for their west and east in turn; `step` moves what pointers there are beside
// these. The first turn is entered behind `x` places. Jumps to words' addresses: into the middle of one takes a
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
    addi {east}, {east}, 64
    addi {north}, {north}, 64
    addi {south}, {south}, 64
    step
    place 0, {a}, {b}
11: place 8, {b}, {a}
12: place 16, {a}, {b}
13: place 24, {b}, {a}
14: place 32, {a}, {b}
15: place 40, {b}, {a}
16: place 48, {a}, {b}
17: place 56, {b}, {a}
18: bne {own}, {end}, 3b
.option pop
.purgem place
.purgem step
