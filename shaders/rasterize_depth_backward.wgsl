// Carries the gradient of depths and normals back through the compositing, as rasterize_backward does
// that of colours, behind which it runs: one thread a tile. What reaches the splats' alphas is added to
// the pairs' gradients; what reaches their depths and normals has a buffer of its own.
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
#import shared/thread_tile
#import shared/depth_backward

// All of every list, which has at most LIST_SLICE entries.
@compute @workgroup_size(WORKGROUP)
fn rasterize_depth_backward(thread: Thread) {
    carry_back(thread_index(thread), 0u, false);
}

// LIST_SLICE entries of every list, the last slice first.
@compute @workgroup_size(WORKGROUP)
fn rasterize_depth_backward_slice(thread: Thread) {
    carry_back(thread_index(thread), slice.first, true);
}

// `sliced` is known where the function is compiled: without slices nothing of them is left.
fn carry_back(thread: u32, slice_first: u32, sliced: bool) {
    let tile = thread_tile(thread);
    if (!tile.exists) {
        return;
    }
    let entries = entries_of(tile.list, slice_first, sliced);
    if (entries.is_over) {
        return;
    }
    // Entries in front of the slice.
    let n_before = entries.first - tile.list.first;
    let goes_on = sliced && entries.end < tile.list.end;
    // Entries blended in the slice and in front of it.
    var n_blended = 0u;
    #repeat r TILE_H
    var row_{r} = depth_gradients(tile.x4, tile.y + {r}u, goes_on);
    n_blended = max(n_blended, max(max(row_{r}.last.x, row_{r}.last.y), max(row_{r}.last.z, row_{r}.last.w)));
    #end
    n_blended = clamp(n_blended, n_before, entries.end - tile.list.first);
    // bound: LIST_SLICE turns, and as many again below.
    for (var i = tile.list.first + n_blended; i < entries.end; i++) {
        d_pair_depth[tile_splat(tile_splats[i]).pair] = vec4f(0.0);
    }
    // bound: LIST_SLICE turns.
    for (var number = n_blended; number > n_before; number--) {
        let entry = tile_splat(tile_splats[tile.list.first + number - 1u]);
        let pair = entry.pair;
        let s = unpacked(splats[entry.gaussian]);
        let f = splat_depths[entry.gaussian];
        let t_x0 = s.t_0.x + s.l_xx * (tile.px - s.anchor.x);
        var sum_v = 0.0;
        var sum_x = 0.0;
        var sum_y = 0.0;
        var sum_xx = vec4f(0.0);
        var sum_xy = 0.0;
        var sum_yy = 0.0;
        var sum_depth = vec4f(0.0);
        var sum_normal_x = vec4f(0.0);
        var sum_normal_y = vec4f(0.0);
        var sum_normal_z = vec4f(0.0);
        #repeat r TILE_H
        {
            let dy = tile.py + {r}.0 - s.anchor.y;
            let t_y = s.t_0.y + s.l_yy * dy;
            let t_x = t_x0 + s.l_xy * dy;
            let raw = s.opacity * exp2_negative(-(t_x * t_x + t_y * t_y));
            let part = carry_depth_back(&row_{r}, number, raw, f);
            let v_x = part.v * t_x;
            let row_v = sum4(part.v);
            let row_x = sum4(v_x);
            sum_v += row_v;
            sum_x += row_x;
            sum_y += row_v * t_y;
            sum_xx += v_x * t_x;
            sum_xy += row_x * t_y;
            sum_yy += row_v * (t_y * t_y);
            sum_depth += part.depth;
            sum_normal_x += part.normal_x;
            sum_normal_y += part.normal_y;
            sum_normal_z += part.normal_z;
        }
        #end
        d_pair_a[pair] += vec4f(sum_v, sum_x, sum_y, sum4(sum_xx));
        d_pair_b[pair] += vec4f(sum_xy, sum_yy, 0.0, 0.0);
        d_pair_depth[pair] = vec4f(sum4(sum_normal_x), sum4(sum_normal_y), sum4(sum_normal_z), sum4(sum_depth));
    }
    if (sliced && n_before > 0u && entries.end > tile.list.first) {
        #repeat r TILE_H
        keep_depth_gradients(row_{r}, tile.x4, tile.y + {r}u);
        #end
    }
}
