// What the projection's backward needs of a splat: the sums over all its pixels (shared/pair_gradient),
// and of the splat itself. It takes the splat's place in `splats` once no pixel needs that any more.
struct SplatGradient {
    // Moments of t.
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    // The splat's; l_xx is 0 where no tile has it.
    l_xx: f32,
    l_xy: f32,
    l_yy: f32,
    // 0 where the colour is clamped at 0.
    color: vec3f,
    opacity_logit: f32,
}

fn packed_gradient(d: SplatGradient) -> SplatVectors {
    return SplatVectors(
        vec4f(d.x, d.y, d.xx, d.xy),
        vec4f(d.l_xx, d.l_xy, d.l_yy, d.yy),
        vec4f(d.color, d.opacity_logit),
    );
}

fn unpacked_gradient(v: SplatVectors) -> SplatGradient {
    return SplatGradient(
        v.anchor_t_0.x,
        v.anchor_t_0.y,
        v.anchor_t_0.z,
        v.anchor_t_0.w,
        v.factor_reach.w,
        v.factor_reach.x,
        v.factor_reach.y,
        v.factor_reach.z,
        v.color_opacity.xyz,
        v.color_opacity.w,
    );
}
