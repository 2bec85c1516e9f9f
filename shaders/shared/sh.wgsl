// Real spherical harmonics up to degree 3 in 3DGS's order and signs.
// Coefficients are packed: float 3k+c of a Gaussian is coefficient k of channel c, four floats a
// vec4f plane; planes 0-2 lie in `sh_0`, 3-6 in `sh_2`, 7-11 in `sh_3`.
fn sh_basis(d: vec3f, degree: u32) -> array<f32, 16> {
    var y: array<f32, 16>;
    y[0] = SH_0;
    if (degree >= 1u) {
        y[1] = -SH_1 * d.y;
        y[2] = SH_1 * d.z;
        y[3] = -SH_1 * d.x;
    }
    if (degree >= 2u) {
        let s = d * d;
        y[4] = SH_2_0 * d.x * d.y;
        y[5] = -SH_2_0 * d.y * d.z;
        y[6] = SH_2_1 * (2.0 * s.z - s.x - s.y);
        y[7] = -SH_2_0 * d.x * d.z;
        y[8] = SH_2_2 * (s.x - s.y);
    }
    if (degree >= 3u) {
        let s = d * d;
        y[9] = -SH_3_0 * d.y * (3.0 * s.x - s.y);
        y[10] = SH_3_1 * d.x * d.y * d.z;
        y[11] = -SH_3_2 * d.y * (4.0 * s.z - s.x - s.y);
        y[12] = SH_3_3 * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y);
        y[13] = -SH_3_2 * d.x * (4.0 * s.z - s.x - s.y);
        y[14] = SH_3_4 * d.z * (s.x - s.y);
        y[15] = -SH_3_0 * d.x * (s.x - 3.0 * s.y);
    }
    return y;
}
