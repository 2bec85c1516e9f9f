// Four pixels while the gradient of their depths and normals is carried back; see shared/depth.
#import shared/depth
struct DepthGradients {
    depth: vec4f,
    normal_x: vec4f,
    normal_y: vec4f,
    normal_z: vec4f,
    median: vec4f,
    mode: vec4f,
    transmittance: vec4f,
    // What the splats behind have of the gradient's product with what is rendered, less that with the
    // transmittance.
    behind: vec4f,
    last: vec4u,
    median_number: vec4u,
    mode_number: vec4u,
}

// A splat's gradient from four pixels: v = dL/dalpha alpha, and what reaches its depth and normal.
struct DepthPart {
    v: vec4f,
    depth: vec4f,
    normal_x: vec4f,
    normal_y: vec4f,
    normal_z: vec4f,
}

// `goes_on`: splats farther behind have been carried back already.
fn depth_gradients(x4: u32, y: u32, goes_on: bool) -> DepthGradients {
    let t = depth_plane(DEPTH_TRANSMITTANCE, x4, y);
    let fourth = depth_plane(DEPTH_ALPHA, x4, y);
    return DepthGradients(
        depth_plane(DEPTH_SUM, x4, y),
        depth_plane(DEPTH_NORMAL, x4, y),
        depth_plane(DEPTH_NORMAL + 1u, x4, y),
        depth_plane(DEPTH_NORMAL + 2u, x4, y),
        depth_plane(DEPTH_MEDIAN, x4, y),
        depth_plane(DEPTH_MODE, x4, y),
        t,
        select(-t * fourth, fourth, goes_on),
        depth_bits(DEPTH_LAST, x4, y),
        depth_bits(DEPTH_MEDIAN_NUMBER, x4, y),
        depth_bits(DEPTH_MODE_NUMBER, x4, y),
    );
}

fn keep_depth_gradients(p: DepthGradients, x4: u32, y: u32) {
    depths[plane_index(view, DEPTH_ALPHA, x4, y)] = bitcast<vec4u>(p.behind);
    depths[plane_index(view, DEPTH_TRANSMITTANCE, x4, y)] = bitcast<vec4u>(p.transmittance);
}

// Takes the splat of this number out again, of normal `f.xyz` and depth `f.w`.
fn carry_depth_back(p: ptr<function, DepthGradients>, number: u32, raw: vec4f, f: vec4f) -> DepthPart {
    let blended = (raw >= vec4f(ALPHA_MIN)) & (vec4u(number) <= (*p).last);
    // 0 leaves the transmittance and what is behind as they are, to the bit.
    let alpha = select(vec4f(0.0), min(vec4f(ALPHA_MAX), raw), blended);
    let inverse = 1.0 / (1.0 - alpha);
    let before = (*p).transmittance * inverse;
    let weight = alpha * before;
    let shade = (*p).depth * f.w + ((*p).normal_x * f.x + (*p).normal_y * f.y + (*p).normal_z * f.z);
    let d_alpha = before * shade - (*p).behind * inverse;
    (*p).transmittance = before;
    (*p).behind += weight * shade;
    let of_median = select(vec4f(0.0), (*p).median, (*p).median_number == vec4u(number));
    let of_mode = select(vec4f(0.0), (*p).mode, (*p).mode_number == vec4u(number));
    return DepthPart(
        select(vec4f(0.0), d_alpha * alpha, raw < vec4f(ALPHA_MAX)),
        weight * (*p).depth + (of_median + of_mode),
        weight * (*p).normal_x,
        weight * (*p).normal_y,
        weight * (*p).normal_z,
    );
}
