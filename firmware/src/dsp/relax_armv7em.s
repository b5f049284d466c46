// A place, `node` bytes from where the pointers of nodes are. `west` becomes its own; `east` is the next
// place's west.
.macro place node, west, east
    ldr r0, [{couplings}, #\node / 2]
    ldr \east, [{east}, #\node]
    cbz r0, 99f
    ldr {x}, [{north}, #\node]
    ldr {y}, [{south}, #\node]
    // 2 r.
    add \west, \east
    add {x}, {y}
    add \west, {x}
    ldrd {p}, {y}, [{own}, #\node]
    add \west, {y}
    and {y}, r0, #7
    mls \west, {p}, {y}, \west
    // The step.
    lsl \west, \west, #2
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

    cmp {x}, #2
    blt 11f
    beq 12f
    cmp {x}, #3
    beq 13f
    b 14f
3:  add {couplings}, #16
    add {own}, #32
    add {east}, #32
    add {north}, #32
    add {south}, #32
    place 0, {a}, {b}
11: place 8, {b}, {a}
12: place 16, {a}, {b}
13: place 24, {b}, {a}
14: cmp {own}, {end}
    bne 3b
.purgem place
