// A place: `to` and `each` are where its command and its gains are from their pointers, the others where its neighbours
// are, the east from that of its own. `west` becomes what is taken of it; `east` is the next place's own. Loads stand
// apart from what needs them.
.macro place to, each, east, north, south, west_x, west_y, own_x, own_y, east_x, east_y
    lw {gains}, \each({each})
    lw \east_x, \east({own})
    lw \east_y, \east + 4({own})
    beqz {gains}, 99f
    lw {p}, \north({north})
    lw {known}, \south({south})
    lw {c}, \north + 4({north})
    lw {d}, \south + 4({south})
    // 16 x of the neighbours, and how many were measured.
    add \west_x, \west_x, \east_x
    add {p}, {p}, {known}
    add \west_x, \west_x, {p}
    slli {known}, \own_x, 3
    add {known}, {known}, \west_x
    andi {known}, {known}, 15
    slli {p}, {known}, 2
    add {p}, {p}, {inverses}
    lw {p}, 0({p})
    add \west_y, \west_y, \east_y
    add {c}, {c}, {d}
    add \west_y, \west_y, {c}
    // Their mean, unless it was measured itself.
    mulhsu \west_x, \west_x, {p}
    mulhsu \west_y, \west_y, {p}
    lw {c}, \to({to})
    lw {d}, \to + 4({to})
    add \west_x, \west_x, \own_x
    add \west_y, \west_y, \own_y
    sub \west_x, \west_x, {mean_x}
    sub \west_y, \west_y, {mean_y}
    // Where x is not known it holds.
    snez {known}, {known}
    mul {gains}, {gains}, {known}
    add {gains}, {gains}, {hold}
    add {known}, {known}, {limit}
    slli {p}, {gains}, 17
    and {gains}, {gains}, {upper}
    slli {c}, {c}, 2
    slli {d}, {d}, 2
    mulh {c}, {c}, {p}
    mulh {d}, {d}, {p}
    mulh \west_x, \west_x, {gains}
    mulh \west_y, \west_y, {gains}
    add {c}, {c}, {known}
    add {d}, {d}, {known}
    add {c}, {c}, \west_x
    add {d}, {d}, \west_y
    // Raised by the limit as they are: the lower one, then the upper.
    sgtz \west_x, {c}
    sgtz \west_y, {d}
    mul {c}, {c}, \west_x
    mul {d}, {d}, \west_y
    sub {c}, {c}, {room}
    sub {d}, {d}, {room}
    srai \west_x, {c}, 31
    srai \west_y, {d}, 31
    and {c}, {c}, \west_x
    and {d}, {d}, \west_y
    add {c}, {c}, {highest}
    add {d}, {d}, {highest}
    sw {c}, \to({to})
    sw {d}, \to + 4({to})
99:
.endm

// The `i`-th red place from where the pointers are, and the black one to its east: red and black are `half` before and
// behind the pointers, or half as far.
.macro red i, west_x, west_y, own_x, own_y, east_x, east_y
    place 8 * \i - {half}, 4 * \i - {half} / 2, 8 * \i + {half}, 8 * \i + {half}, 8 * \i + {half}, \west_x, \west_y, \own_x, \own_y, \east_x, \east_y
.endm
.macro black i, west_x, west_y, own_x, own_y, east_x, east_y
    place 8 * \i + {half}, 4 * \i + {half} / 2, 8 * \i + 8 - {half}, 8 * \i + 8 - {half}, 8 * \i + 8 - {half}, \west_x, \west_y, \own_x, \own_y, \east_x, \east_y
.endm

// The first turn is entered behind `p` pairs and a red place. Jumps to words' addresses: into the middle of one takes a
// cycle more.
.option push
.option norvc
.p2align 2
    addi {p}, {p}, -2
    bgtz {p}, 2f
    beqz {p}, 13f
    addi {p}, {p}, 1
    beqz {p}, 12f
    j 11f
2:  addi {p}, {p}, -2
    bltz {p}, 14f
    beqz {p}, 15f
    j 16f
3:  red 0, {ax}, {ay}, {bx}, {by}, {cx}, {cy}
11: black 0, {bx}, {by}, {cx}, {cy}, {ax}, {ay}
    red 1, {cx}, {cy}, {ax}, {ay}, {bx}, {by}
12: black 1, {ax}, {ay}, {bx}, {by}, {cx}, {cy}
    red 2, {bx}, {by}, {cx}, {cy}, {ax}, {ay}
13: black 2, {cx}, {cy}, {ax}, {ay}, {bx}, {by}
    red 3, {ax}, {ay}, {bx}, {by}, {cx}, {cy}
14: black 3, {bx}, {by}, {cx}, {cy}, {ax}, {ay}
    red 4, {cx}, {cy}, {ax}, {ay}, {bx}, {by}
15: black 4, {ax}, {ay}, {bx}, {by}, {cx}, {cy}
    red 5, {bx}, {by}, {cx}, {cy}, {ax}, {ay}
16: black 5, {cx}, {cy}, {ax}, {ay}, {bx}, {by}
    addi {own}, {own}, 8 * {turn}
    addi {north}, {north}, 8 * {turn}
    addi {south}, {south}, 8 * {turn}
    addi {to}, {to}, 8 * {turn}
    addi {each}, {each}, 4 * {turn}
    bne {own}, {end}, 3b
.option pop
.purgem place
.purgem red
.purgem black
