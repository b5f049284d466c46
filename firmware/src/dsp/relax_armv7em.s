// A place, `node` bytes from where the pointers of nodes are. `west` becomes its own; `east` is the next
// place's west.
.macro place node, west, east
    ldr r0, [{each}, #\node / 2]
    ldr \east, [{east}, #\node]
    cbz r0, 99f
    ldr {x}, [{north}, #\node]
    ldr {y}, [{south}, #\node]
    // 8 r.
    add \west, \east
    add {x}, {y}
    add \west, {x}
    ldrd {p}, {y}, [{own}, #\node]
    and {x}, r0, #7
    mls \west, {p}, {x}, \west
    add \west, {y}, \west, lsl #2
    // The step.
    smmla {p}, \west, r0, {p}
    // The upper limit, the lower one, which an instruction holds, and rounding.
    and {p}, {p}, {p}, asr #31
    add {x}, {p}, #{room}
    and {x}, {x}, {x}, asr #31
    sub {p}, {x}
    orr {p}, {p}, #1
    str {p}, [{own}, #\node]
99:
.endm

    cmp {x}, #4
    bgt 2f
    beq 14f
    cmp {x}, #2
    blt 11f
    beq 12f
    b 13f
2:  cmp {x}, #6
    blt 15f
    beq 16f
    cmp {x}, #7
    beq 17f
    b 18f
3:  add {each}, #32
    add {own}, #64
    add {east}, #64
    add {north}, #64
    add {south}, #64
    place 0, {a}, {b}
11: place 8, {b}, {a}
12: place 16, {a}, {b}
13: place 24, {b}, {a}
14: place 32, {a}, {b}
15: place 40, {b}, {a}
16: place 48, {a}, {b}
17: place 56, {b}, {a}
18: cmp {own}, {end}
    bne 3b
.purgem place
