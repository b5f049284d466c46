// A place, `node` bytes from where the pointers of nodes are. `west` becomes its own; `east` is the next
// place's west. Loads stand apart from what needs them.
.macro place node, west_x, west_y, east_x, east_y
    lw {gains}, \node / 2({each})
    lw \east_x, \node({east})
    lw \east_y, \node + 4({east})
    beqz {gains}, 99f
    lw {p}, \node({north})
    lw {known}, \node({south})
    lw {c}, \node + 4({north})
    lw {d}, \node + 4({south})
    lw {x}, \node({own})
    lw {y}, \node + 4({own})
    // 16 x of the neighbours, and how many were measured.
    add \west_x, \west_x, \east_x
    add {p}, {p}, {known}
    add \west_x, \west_x, {p}
    slli {known}, {x}, 3
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
    lw {c}, \node({to})
    lw {d}, \node + 4({to})
    sub {x}, {x}, {mean_x}
    sub {y}, {y}, {mean_y}
    add {x}, {x}, \west_x
    add {y}, {y}, \west_y
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
    mulh {x}, {x}, {gains}
    mulh {y}, {y}, {gains}
    add {c}, {c}, {known}
    add {d}, {d}, {known}
    add {c}, {c}, {x}
    add {d}, {d}, {y}
    // Raised by the limit as they are: the lower one, then the upper.
    sgtz {x}, {c}
    sgtz {y}, {d}
    mul {c}, {c}, {x}
    mul {d}, {d}, {y}
    sub {c}, {c}, {room}
    sub {d}, {d}, {room}
    srai {x}, {c}, 31
    srai {y}, {d}, 31
    and {c}, {c}, {x}
    and {d}, {d}, {y}
    add {c}, {c}, {highest}
    add {d}, {d}, {highest}
    sw {c}, \node({to})
    sw {d}, \node + 4({to})
99:
.endm

.macro even node
    place \node, {ax}, {ay}, {bx}, {by}
.endm
.macro odd node
    place \node, {bx}, {by}, {ax}, {ay}
.endm
.macro step
    addi {east}, {east}, 64
    addi {north}, {north}, 64
    addi {south}, {south}, 64
    addi {to}, {to}, 64
.endm
