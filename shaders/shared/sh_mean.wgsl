// dL/dmean of a Gaussian through the direction in which its colour is seen, from dL/dcolour: needs
// `view`, `sh_0`, `sh_2` and `sh_3`. The offset from the camera's centre must not be 0.
fn color_to_mean(offset: vec3f, id: u32, d_c: vec3f) -> vec3f {
    let stride = view.stride;
    let distance = length(offset);
    let direction = offset / distance;
    let a = sh_dots(sh_0[id], sh_0[stride + id], sh_0[2u * stride + id], d_c);
    var b = vec4f(0.0);
    var c = vec4f(0.0);
    var d = vec4f(0.0);
    if (SH_DEGREE >= 2u) {
        b = sh_dots(sh_2[id], sh_2[stride + id], sh_2[2u * stride + id], d_c);
        let p6 = sh_2[3u * stride + id];
        c.x = dot(p6.xyz, d_c);
        if (SH_DEGREE >= 3u) {
            c = sh_dots(p6, sh_3[id], sh_3[stride + id], d_c);
            d = sh_dots(sh_3[2u * stride + id], sh_3[3u * stride + id], sh_3[4u * stride + id], d_c);
        }
    }
    let d_direction = sh_direction_gradient(direction, a, b, c, d);
    return (d_direction - direction * dot(direction, d_direction)) / distance;
}
