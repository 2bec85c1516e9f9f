// Keys of the depth sort: one thread a Gaussian. Splats that are not drawn come last.
#import shared/view

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<vec4f>;
// (key, Gaussian).
@group(0) @binding(2) var<storage, read_write> depth_order: array<vec2u>;

@compute @workgroup_size(WORKGROUP)
fn depth_keys(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let id = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (id >= view.counts.x) {
        return;
    }
    let s1 = splats[3u * id + 1u];
    // Depths lie beyond the near plane, so that their bits, which order as they do, fit 30 bits.
    let key = bitcast<u32>(s1.z) - bitcast<u32>(view.center_near.w);
    depth_order[id] = vec2u(select(0x3fffffffu, min(key, 0x3ffffffeu), s1.w > 0.0), id);
}
