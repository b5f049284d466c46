// Two a turn; an odd first one enters in the middle. Jumps to words' addresses: into the middle of one takes a
// cycle more.
    bnez {a}, 2f
.p2align 2
3:  square 0, 9f
.p2align 2
2:  square 1, 8f
    lw {a}, 20({shared})
    addi {start}, {start}, 8
    addi {tracking}, {tracking}, 2 * {trackings}
    addi {floor}, {floor}, 256
    addi {window}, {window}, 2 * {windows}
    bne {window}, {a}, 3b
    j 9f
8:  addi {window}, {window}, {windows}
9:
.purgem begin
.purgem rows
.purgem signals
.purgem upper
.purgem lower
.purgem watch
.purgem square
.purgem sums
