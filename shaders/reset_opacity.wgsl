// 3DGS's opacity reset: opacities fall to a ceiling and their Adam moments to zero.
#import shared/thread

@group(0) @binding(0) var<uniform> ceiling: vec4f; // x: largest logit that stays, y: distance from the focus beyond which all do
@group(0) @binding(1) var<uniform> counts: vec4u; // x: number of Gaussians
@group(0) @binding(2) var<storage, read_write> geometry: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> first_moment: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> second_moment: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn reset_opacity(thread: Thread) {
    let id = thread_index(thread);
    if (id >= counts.x || length(geometry[id].xyz) > ceiling.y) {
        return;
    }
    geometry[id].w = min(geometry[id].w, ceiling.x);
    first_moment[id].w = 0.0;
    second_moment[id].w = 0.0;
}
