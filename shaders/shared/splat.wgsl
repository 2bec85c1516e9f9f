// A splat is a Gaussian projected into the view. In the pixel (dx, dy) from the anchor,
//   alpha = opacity 2^-(t_x^2 + t_y^2),  t_x = t_0.x + l_xx dx + l_xy dy,  t_y = t_0.y + l_yy dy:
// L is the Cholesky factor of the conic, scaled by sqrt(log2(e) / 2). Nothing cancels in it, however
// elongated the splat is. The anchor is the image's pixel centre nearest to the projected mean, so
// that dx and dy are whole numbers, and t_0 = L (anchor - mean) is rounded once: of a mean 1e5
// pixels off the image, f32 would keep no hundredth of a pixel.
struct Splat {
    anchor: vec2f,
    t_0: vec2f,
    l_xx: f32,
    l_xy: f32,
    l_yy: f32,
    // log2(255 opacity), which bounds t_x^2 + t_y^2; 0 where the Gaussian is not drawn.
    reach: f32,
    color: vec3f,
    opacity: f32,
}

// The same bytes as three vectors: a software driver loads a vector as fast as one number.
struct SplatVectors {
    anchor_t_0: vec4f,
    factor_reach: vec4f,
    color_opacity: vec4f,
}

fn unpacked(v: SplatVectors) -> Splat {
    return Splat(
        v.anchor_t_0.xy,
        v.anchor_t_0.zw,
        v.factor_reach.x,
        v.factor_reach.y,
        v.factor_reach.z,
        v.factor_reach.w,
        v.color_opacity.xyz,
        v.color_opacity.w,
    );
}

fn packed(s: Splat) -> SplatVectors {
    return SplatVectors(vec4f(s.anchor, s.t_0), vec4f(s.l_xx, s.l_xy, s.l_yy, s.reach), vec4f(s.color, s.opacity));
}
