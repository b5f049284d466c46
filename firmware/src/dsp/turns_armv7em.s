// Four places a turn, of what `even` and `odd` do; `step` moves what pointers there are beside these, and
// `compare` says whether the last turn is done. The first one is entered behind r4 places.
// What is at a node is r8, its neighbours to the east, north and south r9, r10 and r11; in step with it r12,
// to be written, and lr.
    cmp r4, #2
    blt 11f
    beq 12f
    cmp r4, #3
    beq 13f
    b 14f
3:  add lr, #16
    add r8, #32
    step
    even 0
11: odd 8
12: even 16
13: odd 24
14: compare
    bne 3b
.purgem place
.purgem even
.purgem odd
.purgem step
.purgem compare
