// The gradient of a splat from the pixels of one tile: sums over them, with v = dL/dalpha alpha the
// gradient of the splat's exponent. Three buffers hold a pair's nine numbers:
//   d_pair_a: v, v t_x, v t_y, v t_x^2   d_pair_b: v t_x t_y, v t_y^2, red, green   d_pair_c: blue
struct PairGradient {
    v: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    color: vec3f,
}

fn pair_gradient(a: vec4f, b: vec4f, c: f32) -> PairGradient {
    return PairGradient(a.x, a.y, a.z, a.w, b.x, b.y, vec3f(b.zw, c));
}
