// Projects every Gaussian into the view: one thread a Gaussian.
//
// A splat is three vec4f planes of `stride` entries:
//   0: u, v, l_xx, l_xy   1: l_yy, opacity, depth, reach   2: r, g, b, 0
// with alpha(dx, dy) = opacity 2^-(t_x^2 + t_y^2), t_x = l_xx dx + l_xy dy, t_y = l_yy dy: the
// Cholesky factor of the conic, scaled by sqrt(log2(e) / 2). Nothing cancels in it, however
// elongated the splat is. `reach` = log2(255 opacity) bounds t_x^2 + t_y^2; it is 0 where the
// Gaussian is not drawn.
#import shared/view
#import shared/gaussian
#import shared/dropout
#import shared/sh

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4f>;
@group(0) @binding(2) var<storage, read> sh_0: array<vec4f>;
@group(0) @binding(3) var<storage, read> sh_2: array<vec4f>;
@group(0) @binding(4) var<storage, read> sh_3: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> splats: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn project(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let id = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (id >= view.counts.x) {
        return;
    }
    let stride = view.counts.y;
    let g0 = geometry[id];
    let g1 = geometry[stride + id];
    let g2 = geometry[2u * stride + id];
    let g = Gaussian(g0.xyz, g0.w, g1.xyz, g2);
    splats[3u * id + 1u] = vec4f(0.0);
    if (is_dropped(view, id, g.mean, g1.w)) {
        return;
    }

    let o = project_gaussian(view, g);
    if (!(o.p.z > view.center_near.w)) {
        return;
    }
    // Above 1 it widens the core in which alpha is capped.
    let opacity = sigmoid(g.opacity_logit) / kept_share(view);
    let reach = log2(255.0 * opacity);
    if (!(reach > 0.0)) {
        return;
    }
    let a = dot(o.m_x, o.m_x);
    let c = dot(o.m_y, o.m_y);
    let b = dot(o.m_x, o.m_y);
    let cov_yy = c + DILATION;
    // Variance of x given y: det / cov_yy, with det(M M^T) as a sum of squares of minors.
    let minors = cross(o.m_x, o.m_y / sqrt(cov_yy));
    let var_x = dot(minors, minors) + DILATION * (a + c + DILATION) / cov_yy;
    let l_xx = CONIC_SCALE / sqrt(var_x);
    let l_xy = -(b / cov_yy) * l_xx;
    let l_yy = CONIC_SCALE / sqrt(cov_yy);
    let mean2d = view.intrinsics.xy * o.ratio + view.intrinsics.zw;
    // One sum carries every NaN and infinity there may be.
    if (!is_finite(mean2d.x + mean2d.y + l_xx + l_xy + l_yy + a + c + opacity) || !(l_xx > 1e-18) || !(l_yy > 1e-18)) {
        return;
    }

    let direction = normalize(g.mean - view.center_near.xyz);
    let y = sh_basis(direction);
    let p0 = sh_0[id];
    var color = vec3f(0.5) + y.a.x * p0.xyz;
    if (SH_DEGREE >= 1u) {
        color = vec3f(0.5) + sh_sum(y.a, p0, sh_0[stride + id], sh_0[2u * stride + id]);
    }
    if (SH_DEGREE >= 2u) {
        color += sh_sum(y.b, sh_2[id], sh_2[stride + id], sh_2[2u * stride + id]);
        let p6 = sh_2[3u * stride + id];
        if (SH_DEGREE == 2u) {
            color += y.c.x * p6.xyz;
        } else {
            color += sh_sum(y.c, p6, sh_3[id], sh_3[stride + id]);
            color += sh_sum(y.d, sh_3[2u * stride + id], sh_3[3u * stride + id], sh_3[4u * stride + id]);
        }
    }
    if (!is_finite(color.x + color.y + color.z)) {
        return;
    }

    splats[3u * id] = vec4f(mean2d, l_xx, l_xy);
    splats[3u * id + 1u] = vec4f(l_yy, opacity, o.p.z, reach);
    splats[3u * id + 2u] = vec4f(max(color, vec3f(0.0)), 0.0);
}
