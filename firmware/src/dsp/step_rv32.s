// The step of a node's `u` with right-hand side `rhs` and step `k`: `x` is the sum of its sides before, the bracket
// then, and `to` what `u` becomes; it may be `x` itself. `u` is lost.
.macro take_step x, u, rhs, k, to
    add \x, \x, \rhs
    widen \x
    mulhsu \u, \u, {overshoot}
    mulhsu \to, \x, \k
    sub \to, \to, \u
    limit \to, \u
.endm
