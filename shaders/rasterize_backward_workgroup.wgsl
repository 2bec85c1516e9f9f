// Carries the gradient back through the compositing, as rasterize_backward does, for GPUs: one workgroup a
// tile. Each thread has the nine sums of a splat (shared/pair_gradient) over its own four pixels; those of
// the workgroup's threads are added up in a tree in workgroup memory, in an order that no driver changes: its
// first level of TREES splats at a time, its second of ROUNDS times as many, of which a thread has one number.
#import shared/thread
#import shared/view
#import shared/splat
#import shared/entries
#import shared/pair_gradient

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<SplatVectors>;
@group(0) @binding(2) var<storage, read> tile_order: array<vec4u>;
@group(0) @binding(3) var<storage, read> tile_splats: array<vec2u>;
// Written where lists are sliced alone.
@group(0) @binding(4) var<storage, read_write> rendered: array<vec4f>;
// Bits of planes d_r, d_g, d_b, d_alpha: gradient of the loss with respect to the render. Plane
// `view.blended_plane`: what the rasterizer has blended last.
@group(0) @binding(5) var<storage, read> d_rendered: array<vec4u>;
// Per pair: the parts of a PairGradient, four numbers, four and one. Not vectors, as threads store a number each, and a store to a
// part of a vector may write all of it.
@group(0) @binding(6) var<storage, read_write> d_pair_a: array<f32>;
@group(0) @binding(7) var<storage, read_write> d_pair_b: array<f32>;
@group(0) @binding(8) var<storage, read_write> d_pair_c: array<f32>;
@group(0) @binding(9) var<uniform> slice: Slice;

#import shared/tile
#import shared/group_tile

// Splats that are fetched together.
const STAGED = 32u;
const TREES = 2u;
// Numbers that a thread adds up at either of a tree's two levels.
const BRANCHES = 8u;
// Times that the first level is made before the second is.
const ROUNDS = 2u;
// Numbers of a PairGradient.
const PARTS = 9u;
// Sums that a first level makes.
const ROUND_SUMS = TREES * BRANCHES * PARTS;

var<workgroup> staged: array<SplatVectors, STAGED>;
var<workgroup> staged_pairs: array<u32, STAGED>;
// A tree's leaves, one a thread: parts a and b of TREES splats in turn, and parts c.
var<workgroup> leaves: array<vec4f, 2u * TREES * WORKGROUP>;
var<workgroup> leaves_c: array<f32, TREES * WORKGROUP>;
// Sums of BRANCHES leaves: splat by splat, branch by branch, the parts side by side.
var<workgroup> branches: array<f32, ROUNDS * ROUND_SUMS>;
// The most entries that a pixel of the tile has blended.
var<workgroup> most_blended: atomic<u32>;

fn gradient(plane: u32, at: GroupPixels) -> vec4f {
    return bitcast<vec4f>(d_rendered[plane_index(view, plane, at.x4, at.y)]);
}

// All of every list, which has at most LIST_SLICE entries.
@compute @workgroup_size(WORKGROUP)
fn rasterize_backward(thread: Thread) {
    carry_back(thread, 0u, false);
}

// LIST_SLICE entries of every list, the last slice first, with the state of rasterize_backward's.
@compute @workgroup_size(WORKGROUP)
fn rasterize_backward_slice(thread: Thread) {
    carry_back(thread, slice.first, true);
}

// `sliced` is known where the function is compiled: without slices nothing of them is left. All threads
// reach every barrier: the list is one of the whole workgroup.
fn carry_back(thread: Thread, slice_first: u32, sliced: bool) {
    let local = thread.local;
    let list = group_list(thread);
    let at = group_pixels(list.tile, local);
    // A pixel outside has blended nothing.
    var d_red: vec4f;
    var d_green: vec4f;
    var d_blue: vec4f;
    var transmittance: vec4f;
    // dot(d_color, colour behind), all splats behind and the background included.
    var behind: vec4f;
    var last: vec4u;
    if (at.inside) {
        d_red = gradient(0u, at);
        d_green = gradient(1u, at);
        d_blue = gradient(2u, at);
        let t = rendered[plane_index(view, 3u, at.x4, at.y)];
        let background = d_red * view.background.x + d_green * view.background.y + d_blue * view.background.z;
        transmittance = t;
        behind = t * (background - gradient(3u, at));
        last = d_rendered[plane_index(view, view.blended_plane, at.x4, at.y)];
    }
    atomicMax(&most_blended, max(max(last.x, last.y), max(last.z, last.w)));
    workgroupBarrier();
    var n_blended = atomicLoad(&most_blended);

    let entries = entries_of(list.range, slice_first, sliced);
    // Entries in front of the slice.
    let n_before = entries.first - list.range.first;
    if (sliced) {
        // Blended in the slice and in front of it.
        n_blended = clamp(n_blended, n_before, entries.end - list.range.first);
        if (at.inside && entries.end < list.range.end) {
            behind = rendered[plane_index(view, 0u, at.x4, at.y)];
        }
    }
    // bound: LIST_SLICE / WORKGROUP turns.
    for (var i = list.range.first + n_blended + local; i < entries.end; i += WORKGROUP) {
        let pair = tile_splat(tile_splats[i]).pair;
        #repeat i 4
        d_pair_a[4u * pair + {i}u] = 0.0;
        d_pair_b[4u * pair + {i}u] = 0.0;
        #end
        d_pair_c[pair] = 0.0;
    }
    // The first of the sums that the thread makes in a first level, and the splat and the number that it adds up in a second.
    let is_c = local >= 2u * TREES * BRANCHES;
    let branch = select(
        (local / (2u * BRANCHES) * BRANCHES + local % BRANCHES) * PARTS + 4u * (local / BRANCHES % 2u),
        (local - 2u * TREES * BRANCHES) * PARTS + 8u,
        is_c,
    );
    let tree = local / PARTS;
    let part = local % PARTS;
    // bound: LIST_SLICE / STAGED turns.
    for (var top = n_blended; top > n_before; top -= min(STAGED, top - n_before)) {
        let n = min(STAGED, top - n_before);
        if (local < n) {
            let entry = tile_splat(tile_splats[list.range.first + top - 1u - local]);
            staged[local] = splats[entry.gaussian];
            staged_pairs[local] = entry.pair;
        } else if (local < STAGED) {
            // Without opacity it is drawn nowhere.
            staged[local] = SplatVectors(vec4f(0.0), vec4f(0.0), vec4f(0.0));
        }
        workgroupBarrier();
        // bound: STAGED / TREES turns.
        for (var j = 0u; j < n; j += TREES) {
            #repeat k 2
            {
                let s = unpacked(staged[j + {k}u]);
                let dy = at.py - s.anchor.y;
                let t_y = s.t_0.y + s.l_yy * dy;
                var a: vec4f;
                var b: vec4f;
                var c: f32;
                if (!is_beyond(s.reach, t_y)) {
                    let t_x = (s.t_0.x + s.l_xx * (at.px - s.anchor.x)) + s.l_xy * dy;
                    let raw = s.opacity * exp2_negative(-(t_x * t_x + t_y * t_y));
                    let blended = (raw >= vec4f(ALPHA_MIN)) & (vec4u(top - j - {k}u) <= last);
                    // 0 leaves the transmittance and what is behind as they are, to the bit.
                    let alpha = select(vec4f(0.0), min(vec4f(ALPHA_MAX), raw), blended);
                    let inverse = 1.0 / (1.0 - alpha);
                    let before = transmittance * inverse;
                    let weight = alpha * before;
                    let shade = d_red * s.color.x + d_green * s.color.y + d_blue * s.color.z;
                    let d_alpha = before * shade - behind * inverse;
                    let v = select(vec4f(0.0), d_alpha * alpha, raw < vec4f(ALPHA_MAX));
                    transmittance = before;
                    behind += weight * shade;
                    let v_x = v * t_x;
                    let row_v = sum4(v);
                    let row_x = sum4(v_x);
                    a = vec4f(row_v, row_x, row_v * t_y, sum4(v_x * t_x));
                    b = vec4f(row_x * t_y, row_v * (t_y * t_y), sum4(weight * d_red), sum4(weight * d_green));
                    c = sum4(weight * d_blue);
                }
                leaves[{k}u * 2u * WORKGROUP + local] = a;
                leaves[({k}u * 2u + 1u) * WORKGROUP + local] = b;
                leaves_c[{k}u * WORKGROUP + local] = c;
            }
            #end
            workgroupBarrier();
            let round = (j / TREES) % ROUNDS;
            if (local < 2u * TREES * BRANCHES) {
                var sum = leaves[local * BRANCHES];
                #repeat i 7
                sum += leaves[local * BRANCHES + {i}u + 1u];
                #end
                #repeat i 4
                branches[round * ROUND_SUMS + branch + {i}u] = sum[{i}];
                #end
            } else if (local < 3u * TREES * BRANCHES) {
                var sum = leaves_c[(local - 2u * TREES * BRANCHES) * BRANCHES];
                #repeat i 7
                sum += leaves_c[(local - 2u * TREES * BRANCHES) * BRANCHES + {i}u + 1u];
                #end
                branches[round * ROUND_SUMS + branch] = sum;
            }
            workgroupBarrier();
            // Leaves may be written again from here on; branches are not before all are past the next
            // barrier.
            if ((round + 1u == ROUNDS || j + TREES >= n) && local < ROUNDS * TREES * PARTS) {
                let number = j - round * TREES + tree;
                // A splat beyond the slice has no pair.
                if (number < n) {
                    let pair = staged_pairs[number];
                    let first = tree * BRANCHES * PARTS + part;
                    var sum = branches[first];
                    #repeat i 7
                    sum += branches[first + ({i}u + 1u) * PARTS];
                    #end
                    if (part < 4u) {
                        d_pair_a[4u * pair + part] = sum;
                    } else if (part < 8u) {
                        d_pair_b[4u * pair + part - 4u] = sum;
                    } else {
                        d_pair_c[pair] = sum;
                    }
                }
            }
        }
        // The pairs have been read.
        workgroupBarrier();
    }
    // What is in front goes on from here.
    if (sliced && at.inside && n_before > 0u && entries.end > list.range.first + n_before) {
        rendered[plane_index(view, 0u, at.x4, at.y)] = behind;
        rendered[plane_index(view, 3u, at.x4, at.y)] = transmittance;
    }
}
