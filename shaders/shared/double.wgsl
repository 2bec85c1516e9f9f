// Arithmetic of twice the digits of f32, on three numbers at once: a number is hi + lo, with lo at
// most half a unit in the last place of hi (Dekker 1971; sums after Knuth). Needs `view`.
#import shared/view
struct Double {
    hi: vec3f,
    lo: vec3f,
}

// `x`, of which the compiler knows nothing: one that reorders sums would find every error to be 0.
fn opaque(x: vec3f) -> vec3f {
    return bitcast<vec3f>(bitcast<vec3u>(x) ^ vec3u(bitcast<u32>(view.zero)));
}

fn double(x: vec3f) -> Double {
    return Double(x, vec3f(0.0));
}

// a + b exactly.
fn two_sum(a: vec3f, b: vec3f) -> Double {
    let sum = opaque(a + b);
    let of_b = opaque(sum - a);
    return Double(sum, (a - (sum - of_b)) + (b - of_b));
}

// The same where `b` is the smaller one.
fn renormalized(a: vec3f, b: vec3f) -> Double {
    let sum = opaque(a + b);
    return Double(sum, b - opaque(sum - a));
}

// The upper 12 bits of the mantissa; products of such halves are exact.
fn upper_half(x: vec3f) -> vec3f {
    return bitcast<vec3f>(bitcast<vec3u>(x) & vec3u(0xfffff000u));
}

// a b exactly.
fn two_product(a: vec3f, b: vec3f) -> Double {
    let product = opaque(a * b);
    let a_1 = upper_half(a);
    let b_1 = upper_half(b);
    let a_0 = a - a_1;
    let b_0 = b - b_1;
    return Double(product, (((a_1 * b_1 - product) + a_1 * b_0) + a_0 * b_1) + a_0 * b_0);
}

fn negated(a: Double) -> Double {
    return Double(-a.hi, -a.lo);
}

fn sum(a: Double, b: Double) -> Double {
    let s = two_sum(a.hi, b.hi);
    return renormalized(s.hi, s.lo + (a.lo + b.lo));
}

fn product(a: Double, b: Double) -> Double {
    let p = two_product(a.hi, b.hi);
    return renormalized(p.hi, p.lo + (a.hi * b.lo + a.lo * b.hi));
}

fn quotient(a: Double, b: Double) -> Double {
    let q = a.hi / b.hi;
    let rest = sum(a, negated(product(double(q), b)));
    return renormalized(q, rest.hi / b.hi);
}

// One of the three numbers, three times.
fn first(a: Double) -> Double {
    return Double(a.hi.xxx, a.lo.xxx);
}

fn second(a: Double) -> Double {
    return Double(a.hi.yyy, a.lo.yyy);
}

fn third(a: Double) -> Double {
    return Double(a.hi.zzz, a.lo.zzz);
}

// dot(a, b), three times.
fn dot_product(a: Double, b: Double) -> Double {
    let p = product(a, b);
    return sum(sum(first(p), second(p)), third(p));
}

fn cross_product(a: Double, b: Double) -> Double {
    return sum(
        product(Double(a.hi.yzx, a.lo.yzx), Double(b.hi.zxy, b.lo.zxy)),
        negated(product(Double(a.hi.zxy, a.lo.zxy), Double(b.hi.yzx, b.lo.yzx))),
    );
}
