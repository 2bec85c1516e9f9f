// Carries the gradient of depths and normals back, as rasterize_depth_backward does, for GPUs: one
// workgroup a tile, whose sums are added up in trees as in rasterize_backward_workgroup.
#import shared/thread
#import shared/view
#import shared/splat
#import shared/entries

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<SplatVectors>;
// Normal in the camera's axes, and depth, a Gaussian.
@group(0) @binding(2) var<storage, read> splat_depths: array<vec4f>;
@group(0) @binding(3) var<storage, read> tile_order: array<vec4u>;
@group(0) @binding(4) var<storage, read> tile_splats: array<vec2u>;
// Gradients. Written where lists are sliced alone.
@group(0) @binding(5) var<storage, read_write> depths: array<vec4u>;
// Per pair: two parts of a PairGradient, and the gradient to normal and depth.
@group(0) @binding(6) var<storage, read_write> d_pair_a: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> d_pair_b: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> d_pair_depth: array<vec4f>;
@group(0) @binding(9) var<uniform> slice: Slice;

#import shared/tile
#import shared/group_tile
#import shared/depth_backward

// Splats that are fetched together.
const STAGED = 32u;
const TREES = 2u;
// Numbers that a thread adds up at either of a tree's two levels.
const BRANCHES = 8u;

var<workgroup> staged: array<SplatVectors, STAGED>;
var<workgroup> staged_depths: array<vec4f, STAGED>;
var<workgroup> staged_pairs: array<u32, STAGED>;
// A tree's leaves, one a thread, for each of three parts of TREES splats.
var<workgroup> leaves: array<vec4f, 3u * TREES * WORKGROUP>;
// Sums of BRANCHES leaves.
var<workgroup> branches: array<vec4f, 3u * TREES * BRANCHES>;
// The most entries that a pixel of the tile has blended.
var<workgroup> most_blended: atomic<u32>;

// All of every list, which has at most LIST_SLICE entries.
@compute @workgroup_size(WORKGROUP)
fn rasterize_depth_backward(thread: Thread) {
    carry_back(thread, 0u, false);
}

// LIST_SLICE entries of every list, the last slice first.
@compute @workgroup_size(WORKGROUP)
fn rasterize_depth_backward_slice(thread: Thread) {
    carry_back(thread, slice.first, true);
}

// `sliced` is known where the function is compiled: without slices nothing of them is left. All threads
// reach every barrier: the list is one of the whole workgroup.
fn carry_back(thread: Thread, slice_first: u32, sliced: bool) {
    let local = thread.local;
    let list = group_list(thread);
    let at = group_pixels(list.tile, local);
    let entries = entries_of(list.range, slice_first, sliced);
    // Entries in front of the slice.
    let n_before = entries.first - list.range.first;
    // A pixel outside has blended nothing.
    var pixels: DepthGradients;
    if (at.inside) {
        pixels = depth_gradients(at.x4, at.y, sliced && entries.end < list.range.end);
    }
    atomicMax(&most_blended, max(max(pixels.last.x, pixels.last.y), max(pixels.last.z, pixels.last.w)));
    workgroupBarrier();
    // Entries blended in the slice and in front of it.
    let n_blended = clamp(atomicLoad(&most_blended), n_before, entries.end - list.range.first);
    // bound: LIST_SLICE / WORKGROUP turns.
    for (var i = list.range.first + n_blended + local; i < entries.end; i += WORKGROUP) {
        d_pair_depth[tile_splat(tile_splats[i]).pair] = vec4f(0.0);
    }
    // bound: LIST_SLICE / STAGED turns.
    for (var top = n_blended; top > n_before; top -= min(STAGED, top - n_before)) {
        let n = min(STAGED, top - n_before);
        if (local < n) {
            let entry = tile_splat(tile_splats[list.range.first + top - 1u - local]);
            staged[local] = splats[entry.gaussian];
            staged_depths[local] = splat_depths[entry.gaussian];
            staged_pairs[local] = entry.pair;
        } else if (local < STAGED) {
            // Without opacity it is drawn nowhere.
            staged[local] = SplatVectors(vec4f(0.0), vec4f(0.0), vec4f(0.0));
            staged_depths[local] = vec4f(0.0);
        }
        workgroupBarrier();
        // bound: STAGED / TREES turns.
        for (var j = 0u; j < n; j += TREES) {
            #repeat k 2
            {
                let s = unpacked(staged[j + {k}u]);
                let dy = at.py - s.anchor.y;
                let t_y = s.t_0.y + s.l_yy * dy;
                let t_x = (s.t_0.x + s.l_xx * (at.px - s.anchor.x)) + s.l_xy * dy;
                let raw = s.opacity * exp2_negative(-(t_x * t_x + t_y * t_y));
                let part = carry_depth_back(&pixels, top - j - {k}u, raw, staged_depths[j + {k}u]);
                let v_x = part.v * t_x;
                let row_v = sum4(part.v);
                let row_x = sum4(v_x);
                leaves[{k}u * 3u * WORKGROUP + local] = vec4f(row_v, row_x, row_v * t_y, sum4(v_x * t_x));
                leaves[({k}u * 3u + 1u) * WORKGROUP + local] = vec4f(row_x * t_y, row_v * (t_y * t_y), 0.0, 0.0);
                leaves[({k}u * 3u + 2u) * WORKGROUP + local] =
                    vec4f(sum4(part.normal_x), sum4(part.normal_y), sum4(part.normal_z), sum4(part.depth));
            }
            #end
            workgroupBarrier();
            if (local < 3u * TREES * BRANCHES) {
                var sum = leaves[local * BRANCHES];
                #repeat i 7
                sum += leaves[local * BRANCHES + {i}u + 1u];
                #end
                branches[local] = sum;
            }
            workgroupBarrier();
            // Leaves may be written again from here on; branches are not before all are past the next
            // barrier.
            if (local < 3u * TREES) {
                let tree = local / 3u;
                let part = local % 3u;
                // A splat beyond the slice has no pair.
                if (j + tree < n) {
                    let pair = staged_pairs[j + tree];
                    var sum = branches[local * BRANCHES];
                    #repeat i 7
                    sum += branches[local * BRANCHES + {i}u + 1u];
                    #end
                    if (part == 0u) {
                        d_pair_a[pair] += sum;
                    } else if (part == 1u) {
                        d_pair_b[pair] += sum;
                    } else {
                        d_pair_depth[pair] = sum;
                    }
                }
            }
        }
        // The pairs have been read.
        workgroupBarrier();
    }
    // What is in front goes on from here.
    if (sliced && at.inside && n_before > 0u && entries.end > list.range.first + n_before) {
        keep_depth_gradients(pixels, at.x4, at.y);
    }
}
