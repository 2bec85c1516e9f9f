// Reads a Gaussian's coefficients and contracts them with the basis. Needs `sh_0`, `sh_2` and
// `sh_3` bound.
fn sh_rest(id: u32, stride: u32, degree: u32) -> array<vec3f, 16> {
    var c: array<vec3f, 16>;
    let p0 = sh_0[id];
    c[0] = p0.xyz;
    if (degree >= 1u) {
        let p1 = sh_0[stride + id];
        let p2 = sh_0[2u * stride + id];
        c[1] = vec3f(p0.w, p1.xy);
        c[2] = vec3f(p1.zw, p2.x);
        c[3] = p2.yzw;
    }
    if (degree >= 2u) {
        let p3 = sh_2[id];
        let p4 = sh_2[stride + id];
        let p5 = sh_2[2u * stride + id];
        let p6 = sh_2[3u * stride + id];
        c[4] = p3.xyz;
        c[5] = vec3f(p3.w, p4.xy);
        c[6] = vec3f(p4.zw, p5.x);
        c[7] = p5.yzw;
        c[8] = p6.xyz;
        if (degree >= 3u) {
            let p7 = sh_3[id];
            let p8 = sh_3[stride + id];
            let p9 = sh_3[2u * stride + id];
            let p10 = sh_3[3u * stride + id];
            let p11 = sh_3[4u * stride + id];
            c[9] = vec3f(p6.w, p7.xy);
            c[10] = vec3f(p7.zw, p8.x);
            c[11] = p8.yzw;
            c[12] = p9.xyz;
            c[13] = vec3f(p9.w, p10.xy);
            c[14] = vec3f(p10.zw, p11.x);
            c[15] = p11.yzw;
        }
    }
    return c;
}

// Gradient of sum_k y_k(d) dot(c_k, d_color) with respect to the direction `d`.
fn sh_direction_gradient(c: array<vec3f, 16>, d: vec3f, degree: u32, d_color: vec3f) -> vec3f {
    var g = vec3f(0.0);
    if (degree >= 1u) {
        g += SH_1 * vec3f(-dot(c[3], d_color), -dot(c[1], d_color), dot(c[2], d_color));
    }
    if (degree >= 2u) {
        let a = dot(c[4], d_color) * SH_2_0;
        let b = -dot(c[5], d_color) * SH_2_0;
        let e = 2.0 * dot(c[6], d_color) * SH_2_1;
        let f = -dot(c[7], d_color) * SH_2_0;
        let h = 2.0 * dot(c[8], d_color) * SH_2_2;
        g += vec3f(
            a * d.y - e * d.x + f * d.z + h * d.x,
            a * d.x + b * d.z - e * d.y - h * d.y,
            b * d.y + 2.0 * e * d.z + f * d.x,
        );
    }
    if (degree >= 3u) {
        let s = d * d;
        let a = -SH_3_0 * dot(c[9], d_color);
        let b = SH_3_1 * dot(c[10], d_color);
        let e = -SH_3_2 * dot(c[11], d_color);
        let f = SH_3_3 * dot(c[12], d_color);
        let h = -SH_3_2 * dot(c[13], d_color);
        let i = SH_3_4 * dot(c[14], d_color);
        let j = -SH_3_0 * dot(c[15], d_color);
        g += vec3f(
            6.0 * a * d.x * d.y + b * d.y * d.z - 2.0 * e * d.x * d.y - 6.0 * f * d.x * d.z
                + h * (4.0 * s.z - 3.0 * s.x - s.y) + 2.0 * i * d.x * d.z + 3.0 * j * (s.x - s.y),
            3.0 * a * (s.x - s.y) + b * d.x * d.z + e * (4.0 * s.z - s.x - 3.0 * s.y)
                - 6.0 * f * d.y * d.z - 2.0 * h * d.x * d.y - 2.0 * i * d.y * d.z
                - 6.0 * j * d.x * d.y,
            b * d.x * d.y + 8.0 * e * d.y * d.z + 3.0 * f * (2.0 * s.z - s.x - s.y)
                + 8.0 * h * d.x * d.z + i * (s.x - s.y),
        );
    }
    return g;
}
