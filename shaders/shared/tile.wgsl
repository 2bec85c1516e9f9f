#import shared/entries
#import shared/whole

// The slice of every list that a dispatch takes.
struct Slice {
    // Its first entry.
    first: u32,
    pad_0: u32,
    pad_1: u32,
    pad_2: u32,
}

// All rasterizers, forward and backward, share this.

// The entries of a list that a dispatch takes: all of them, or a slice.
struct Entries {
    first: u32,
    end: u32,
    // Whether the list has ended before the slice. No list ends before its first, be it empty.
    is_over: bool,
}

// `sliced` is known where this is compiled: without slices nothing of them is left.
fn entries_of(list: Range, slice_first: u32, sliced: bool) -> Entries {
    if (!sliced) {
        return Entries(list.first, list.end, false);
    }
    let length = list.end - list.first;
    let first = list.first + min(slice_first, length);
    return Entries(first, min(list.end, first + LIST_SLICE), slice_first > 0u && slice_first >= length);
}

fn sum4(v: vec4f) -> f32 {
    return (v.x + v.y) + (v.z + v.w);
}

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
    // n stands in the sum's low bits, and the others are shifted out.
    return bitcast<vec4f>(bitcast<vec4i>(p) + (bitcast<vec4i>(n + WHOLE) << vec4u(23u)));
}
