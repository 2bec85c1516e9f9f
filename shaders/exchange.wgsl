// Hands what one set of Gaussians shows to the other, which is trained beside it: a render becomes the
// other's target image, and a step that one has no room for is none of the other's, either.
#import shared/thread
#import shared/view

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> rendered: array<vec4f>;
// The other's, RGBA8, rows as in a plane of `rendered`.
@group(0) @binding(2) var<storage, read_write> goal: array<vec4u>;
@group(0) @binding(3) var<storage, read_write> totals: array<u32>;
@group(0) @binding(4) var<storage, read_write> other_totals: array<u32>;

// 8 bits of a channel of four pixels.
fn levels(plane: u32, i: u32) -> vec4u {
    let color = clamp(rendered[plane * view.plane_vectors + i], vec4f(0.0), vec4f(1.0));
    return vec4u(color * LEVEL_MAX + 0.5);
}

@compute @workgroup_size(WORKGROUP)
fn hand_over(thread: Thread) {
    let i = thread_index(thread);
    if (i >= view.plane_vectors) {
        return;
    }
    goal[i] = levels(0u, i) | (levels(1u, i) << vec4u(8u)) | (levels(2u, i) << vec4u(16u)) | vec4u(0xff000000u);
}

// The earlier step of two, of which 0 is none.
fn earlier(a: u32, b: u32) -> u32 {
    return select(min(a, b), max(a, b), min(a, b) == 0u);
}

@compute @workgroup_size(WORKGROUP)
fn share_overflow(thread: Thread) {
    if (thread_index(thread) > 0u) {
        return;
    }
    let first = earlier(totals[TOTAL_OVERFLOW], other_totals[TOTAL_OVERFLOW]);
    totals[TOTAL_OVERFLOW] = first;
    other_totals[TOTAL_OVERFLOW] = first;
}
