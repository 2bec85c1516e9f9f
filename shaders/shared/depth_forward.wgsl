// Four pixels while their splats are blended, for the depth passes; see shared/depth.
#import shared/depth
struct DepthPixels {
    depth: vec4f,
    normal_x: vec4f,
    normal_y: vec4f,
    normal_z: vec4f,
    median: vec4f,
    mode: vec4f,
    mode_weight: vec4f,
    // Negative once a pixel takes no more splats.
    transmittance: vec4f,
    last: vec4u,
    median_number: vec4u,
    mode_number: vec4u,
}

fn loaded_depths(x4: u32, y: u32) -> DepthPixels {
    return DepthPixels(
        depth_plane(DEPTH_SUM, x4, y),
        depth_plane(DEPTH_NORMAL, x4, y),
        depth_plane(DEPTH_NORMAL + 1u, x4, y),
        depth_plane(DEPTH_NORMAL + 2u, x4, y),
        depth_plane(DEPTH_MEDIAN, x4, y),
        depth_plane(DEPTH_MODE, x4, y),
        depth_plane(DEPTH_ALPHA, x4, y),
        depth_plane(DEPTH_TRANSMITTANCE, x4, y),
        depth_bits(DEPTH_LAST, x4, y),
        depth_bits(DEPTH_MEDIAN_NUMBER, x4, y),
        depth_bits(DEPTH_MODE_NUMBER, x4, y),
    );
}

fn store_depths(p: DepthPixels, x4: u32, y: u32, goes_on: bool) {
    let t = select(abs(p.transmittance), p.transmittance, goes_on);
    depths[plane_index(view, DEPTH_SUM, x4, y)] = bitcast<vec4u>(p.depth);
    depths[plane_index(view, DEPTH_NORMAL, x4, y)] = bitcast<vec4u>(p.normal_x);
    depths[plane_index(view, DEPTH_NORMAL + 1u, x4, y)] = bitcast<vec4u>(p.normal_y);
    depths[plane_index(view, DEPTH_NORMAL + 2u, x4, y)] = bitcast<vec4u>(p.normal_z);
    depths[plane_index(view, DEPTH_MEDIAN, x4, y)] = bitcast<vec4u>(p.median);
    depths[plane_index(view, DEPTH_MODE, x4, y)] = bitcast<vec4u>(p.mode);
    depths[plane_index(view, DEPTH_ALPHA, x4, y)] = bitcast<vec4u>(p.mode_weight);
    depths[plane_index(view, DEPTH_TRANSMITTANCE, x4, y)] = bitcast<vec4u>(t);
    depths[plane_index(view, DEPTH_LAST, x4, y)] = p.last;
    depths[plane_index(view, DEPTH_MEDIAN_NUMBER, x4, y)] = p.median_number;
    depths[plane_index(view, DEPTH_MODE_NUMBER, x4, y)] = p.mode_number;
}

// Blends the splat of this number, of normal `f.xyz` and depth `f.w`, with its falloff times opacity `raw`.
fn blend_depth(p: ptr<function, DepthPixels>, number: u32, raw: vec4f, f: vec4f) {
    let drawn = raw >= vec4f(ALPHA_MIN);
    // 0 leaves everything below as it is, to the bit.
    let alpha = select(vec4f(0.0), min(vec4f(ALPHA_MAX), raw), drawn);
    let before = (*p).transmittance;
    let next = before * (1.0 - alpha);
    let kept = next > vec4f(TRANSMITTANCE_MIN);
    let weight = select(vec4f(0.0), alpha * before, kept);
    (*p).depth += f.w * weight;
    (*p).normal_x += f.x * weight;
    (*p).normal_y += f.y * weight;
    (*p).normal_z += f.z * weight;
    let is_median = kept & (before > vec4f(0.5)) & (next <= vec4f(0.5));
    (*p).median = select((*p).median, vec4f(f.w), is_median);
    (*p).median_number = select((*p).median_number, vec4u(number), is_median);
    let is_mode = weight > (*p).mode_weight;
    (*p).mode = select((*p).mode, vec4f(f.w), is_mode);
    (*p).mode_weight = max((*p).mode_weight, weight);
    (*p).mode_number = select((*p).mode_number, vec4u(number), is_mode);
    (*p).last = select((*p).last, vec4u(number), drawn & kept);
    (*p).transmittance = select(-abs(before), next, kept);
}
