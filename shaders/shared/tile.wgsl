// The slice of every list that a dispatch takes.
struct Slice {
    // Its first entry.
    first: u32,
    pad_0: u32,
    pad_1: u32,
    pad_2: u32,
}

// All rasterizers, forward and backward, share this.

// 2^x for x <= 0 to about 1 ulp, on every driver: drivers may return 2^x with an error that
// a gradient of 1e-5 would see. An adapter whose own has been found to be as good has it in a quarter of the instructions.
fn exp2_negative(x: vec4f) -> vec4f {
    let y = max(x, vec4f(-126.0));
    if (EXP2_OF_ADAPTER) {
        return exp2(y);
    }
    let n = floor(y);
    let f = y - n;
    // Minimax polynomial of 2^f on [0, 1).
    var p = vec4f(EXP2_C6);
    p = p * f + EXP2_C5;
    p = p * f + EXP2_C4;
    p = p * f + EXP2_C3;
    p = p * f + EXP2_C2;
    p = p * f + EXP2_C1;
    p = p * f + 1.0;
    return bitcast<vec4f>(bitcast<vec4i>(p) + (vec4i(n) << vec4u(23u)));
}
