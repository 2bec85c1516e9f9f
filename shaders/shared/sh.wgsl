// Real spherical harmonics up to degree 3 in 3DGS's order and signs.
//
// Coefficients are packed: float 3k+c of a Gaussian is coefficient k of channel c, four floats a
// vec4f plane, so that three planes hold four coefficients of three channels. Planes 0-2 lie in
// `sh_0`, 3-6 in `sh_2`, 7-11 in `sh_3`. Everything is written out by group of four: a
// dynamically indexed local array would live in memory.
struct Basis {
    a: vec4f,
    b: vec4f,
    c: vec4f,
    d: vec4f,
}

// Values in direction `d`; 0 beyond the active degree, SH_DEGREE.
fn sh_basis(d: vec3f) -> Basis {
    var y: Basis;
    y.a.x = SH_0;
    if (SH_DEGREE >= 1u) {
        y.a = vec4f(SH_0, -SH_1 * d.y, SH_1 * d.z, -SH_1 * d.x);
    }
    let s = d * d;
    if (SH_DEGREE >= 2u) {
        y.b = vec4f(
            SH_2_0 * d.x * d.y,
            -SH_2_0 * d.y * d.z,
            SH_2_1 * (2.0 * s.z - s.x - s.y),
            -SH_2_0 * d.x * d.z,
        );
        y.c.x = SH_2_2 * (s.x - s.y);
    }
    if (SH_DEGREE >= 3u) {
        y.c = vec4f(
            y.c.x,
            -SH_3_0 * d.y * (3.0 * s.x - s.y),
            SH_3_1 * d.x * d.y * d.z,
            -SH_3_2 * d.y * (4.0 * s.z - s.x - s.y),
        );
        y.d = vec4f(
            SH_3_3 * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y),
            -SH_3_2 * d.x * (4.0 * s.z - s.x - s.y),
            SH_3_4 * d.z * (s.x - s.y),
            -SH_3_0 * d.x * (s.x - 3.0 * s.y),
        );
    }
    return y;
}

// sum_k y_k c_k over a group's four coefficients in planes p, q, r.
fn sh_sum(y: vec4f, p: vec4f, q: vec4f, r: vec4f) -> vec3f {
    return y.x * p.xyz + y.y * vec3f(p.w, q.xy) + y.z * vec3f(q.zw, r.x) + y.w * r.yzw;
}

// dot(c_k, color) of a group's four coefficients.
fn sh_dots(p: vec4f, q: vec4f, r: vec4f, color: vec3f) -> vec4f {
    return vec4f(dot(p.xyz, color), dot(vec3f(p.w, q.xy), color), dot(vec3f(q.zw, r.x), color), dot(r.yzw, color));
}

// Gradient of sum_k y_k(d) s_k with respect to the direction, s_k = dot(c_k, d_color) by group.
fn sh_direction_gradient(d: vec3f, a: vec4f, b: vec4f, c: vec4f, e: vec4f) -> vec3f {
    let s = d * d;
    var g = SH_1 * vec3f(-a.w, -a.y, a.z);
    let b_x = SH_2_0 * b.x;
    let b_y = -SH_2_0 * b.y;
    let b_z = 2.0 * SH_2_1 * b.z;
    let b_w = -SH_2_0 * b.w;
    let c_x = 2.0 * SH_2_2 * c.x;
    g += vec3f(
        b_x * d.y - b_z * d.x + b_w * d.z + c_x * d.x,
        b_x * d.x + b_y * d.z - b_z * d.y - c_x * d.y,
        b_y * d.y + 2.0 * b_z * d.z + b_w * d.x,
    );
    let c_y = -SH_3_0 * c.y;
    let c_z = SH_3_1 * c.z;
    let c_w = -SH_3_2 * c.w;
    let e_x = SH_3_3 * e.x;
    let e_y = -SH_3_2 * e.y;
    let e_z = SH_3_4 * e.z;
    let e_w = -SH_3_0 * e.w;
    g += vec3f(
        6.0 * c_y * d.x * d.y + c_z * d.y * d.z - 2.0 * c_w * d.x * d.y - 6.0 * e_x * d.x * d.z
            + e_y * (4.0 * s.z - 3.0 * s.x - s.y) + 2.0 * e_z * d.x * d.z + 3.0 * e_w * (s.x - s.y),
        3.0 * c_y * (s.x - s.y) + c_z * d.x * d.z + c_w * (4.0 * s.z - s.x - 3.0 * s.y)
            - 6.0 * e_x * d.y * d.z - 2.0 * e_y * d.x * d.y - 2.0 * e_z * d.y * d.z
            - 6.0 * e_w * d.x * d.y,
        c_z * d.x * d.y + 8.0 * c_w * d.y * d.z + 3.0 * e_x * (2.0 * s.z - s.x - s.y)
            + 8.0 * e_y * d.x * d.z + e_z * (s.x - s.y),
    );
    return g;
}
