// Carries the gradient back through the compositing: one thread a tile, as rasterize, back to front, so that
// the transmittance before a splat follows from that behind it by one division.
//
// A pair gets nine sums (shared/pair_gradient). Moments of t (|t| < 3) keep the gradient of position
// and covariance well conditioned for any elongation; the chain to them follows once per Gaussian.
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
// Per pair: the parts of a PairGradient.
@group(0) @binding(6) var<storage, read_write> d_pair_a: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> d_pair_b: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> d_pair_c: array<f32>;
@group(0) @binding(9) var<uniform> slice: Slice;

#import shared/tile
#import shared/thread_tile

fn gradient(plane: u32, x4: u32, y: u32) -> vec4f {
    return bitcast<vec4f>(d_rendered[plane_index(view, plane, x4, y)]);
}

// All of every list, which has at most LIST_SLICE entries.
@compute @workgroup_size(WORKGROUP)
fn rasterize_backward(thread: Thread) {
    carry_back(thread_index(thread), 0u, false);
}

// LIST_SLICE entries of every list, the last slice first. A tile whose list goes on in front
// leaves its state in `rendered`: what is behind in plane 0, the transmittance in plane 3.
@compute @workgroup_size(WORKGROUP)
fn rasterize_backward_slice(thread: Thread) {
    carry_back(thread_index(thread), slice.first, true);
}

// `sliced` is known where the function is compiled: without slices nothing of them is left.
fn carry_back(thread: u32, slice_first: u32, sliced: bool) {
    let tile = thread_tile(thread);
    if (!tile.exists) {
        return;
    }
    #repeat r TILE_H
    var d_red_{r}: vec4f;
    var d_green_{r}: vec4f;
    var d_blue_{r}: vec4f;
    var transmittance_{r}: vec4f;
    // dot(d_color, colour behind), all splats behind and the background included.
    var behind_{r}: vec4f;
    var last_{r}: vec4u;
    #end
    var n_blended = 0u;
    #repeat r TILE_H
    {
        d_red_{r} = gradient(0u, tile.x4, tile.y + {r}u);
        d_green_{r} = gradient(1u, tile.x4, tile.y + {r}u);
        d_blue_{r} = gradient(2u, tile.x4, tile.y + {r}u);
        let d_alpha = gradient(3u, tile.x4, tile.y + {r}u);
        let t = rendered[plane_index(view, 3u, tile.x4, tile.y + {r}u)];
        let background = d_red_{r} * view.background.x + d_green_{r} * view.background.y + d_blue_{r} * view.background.z;
        transmittance_{r} = t;
        behind_{r} = t * (background - d_alpha);
        last_{r} = d_rendered[plane_index(view, view.blended_plane, tile.x4, tile.y + {r}u)];
        n_blended = max(n_blended, max(max(last_{r}.x, last_{r}.y), max(last_{r}.z, last_{r}.w)));
    }
    #end

    let entries = entries_of(tile.list, slice_first, sliced);
    if (entries.is_over) {
        return;
    }
    // Entries in front of the slice.
    let n_before = entries.first - tile.list.first;
    if (sliced) {
        // Blended in the slice and in front of it.
        n_blended = clamp(n_blended, n_before, entries.end - tile.list.first);
        if (entries.end < tile.list.end) {
            #repeat r TILE_H
            behind_{r} = rendered[plane_index(view, 0u, tile.x4, tile.y + {r}u)];
            #end
        }
    }
    // bound: LIST_SLICE turns, and as many again below.
    for (var i = tile.list.first + n_blended; i < entries.end; i++) {
        let pair = tile_splat(tile_splats[i]).pair;
        d_pair_a[pair] = vec4f(0.0);
        d_pair_b[pair] = vec4f(0.0);
        d_pair_c[pair] = 0.0;
    }
    // bound: LIST_SLICE turns.
    for (var number = n_blended; number > n_before; number--) {
        let entry = tile_splat(tile_splats[tile.list.first + number - 1u]);
        let pair = entry.pair;
        let s = unpacked(splats[entry.gaussian]);
        let t_x0 = s.t_0.x + s.l_xx * (tile.px - s.anchor.x);
        var sum_v = 0.0;
        var sum_x = 0.0;
        var sum_y = 0.0;
        var sum_xx = vec4f(0.0);
        var sum_xy = 0.0;
        var sum_yy = 0.0;
        var sum_r = vec4f(0.0);
        var sum_g = vec4f(0.0);
        var sum_b = vec4f(0.0);
        #repeat r TILE_H
        {
            let dy = tile.py + {r}.0 - s.anchor.y;
            let t_y = s.t_0.y + s.l_yy * dy;
            let t_x = t_x0 + s.l_xy * dy;
            let raw = s.opacity * exp2_negative(-(t_x * t_x + t_y * t_y));
            let blended = (raw >= vec4f(ALPHA_MIN)) & (vec4u(number) <= last_{r});
            // 0 leaves the transmittance and what is behind as they are, to the bit.
            let alpha = select(vec4f(0.0), min(vec4f(ALPHA_MAX), raw), blended);
            let inverse = 1.0 / (1.0 - alpha);
            let before = transmittance_{r} * inverse;
            let weight = alpha * before;
            let shade = d_red_{r} * s.color.x + d_green_{r} * s.color.y + d_blue_{r} * s.color.z;
            let d_alpha = before * shade - behind_{r} * inverse;
            let v = select(vec4f(0.0), d_alpha * alpha, raw < vec4f(ALPHA_MAX));
            transmittance_{r} = before;
            behind_{r} += weight * shade;
            let v_x = v * t_x;
            let row_v = sum4(v);
            let row_x = sum4(v_x);
            sum_v += row_v;
            sum_x += row_x;
            sum_y += row_v * t_y;
            sum_xx += v_x * t_x;
            sum_xy += row_x * t_y;
            sum_yy += row_v * (t_y * t_y);
            sum_r += weight * d_red_{r};
            sum_g += weight * d_green_{r};
            sum_b += weight * d_blue_{r};
        }
        #end
        d_pair_a[pair] = vec4f(sum_v, sum_x, sum_y, sum4(sum_xx));
        d_pair_b[pair] = vec4f(sum_xy, sum_yy, sum4(sum_r), sum4(sum_g));
        d_pair_c[pair] = sum4(sum_b);
    }
    if (sliced && n_before > 0u && entries.end > tile.list.first) {
        #repeat r TILE_H
        rendered[plane_index(view, 0u, tile.x4, tile.y + {r}u)] = behind_{r};
        rendered[plane_index(view, 3u, tile.x4, tile.y + {r}u)] = transmittance_{r};
        #end
    }
}
