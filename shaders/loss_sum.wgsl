// Sums the losses' partials in a fixed order, in two dispatches: each workgroup a block, then one
// workgroup the blocks.
#import shared/thread
#import shared/loss

@group(0) @binding(0) var<uniform> loss: Loss;
@group(0) @binding(1) var<storage, read> partials: array<vec2f>;
@group(0) @binding(2) var<storage, read_write> block_partials: array<vec2f>;
// Per loss of the step: mean L1, mean SSIM.
@group(0) @binding(3) var<storage, read_write> losses: array<vec2f>;

const BLOCK = SCAN_CHUNK * WORKGROUP;

var<workgroup> sums: array<vec2f, WORKGROUP>;

fn workgroup_sum(local: u32, mine: vec2f) -> vec2f {
    sums[local] = mine;
    workgroupBarrier();
    var sum = vec2f(0.0);
    if (local == 0u) {
        // bound: WORKGROUP turns.
        for (var i = 0u; i < WORKGROUP; i++) {
            sum += sums[i];
        }
    }
    return sum;
}

@compute @workgroup_size(WORKGROUP)
fn loss_blocks(thread: Thread) {
    let block = workgroup_index(thread);
    let first = block * BLOCK + thread.local * SCAN_CHUNK;
    var mine = vec2f(0.0);
    // bound: SCAN_CHUNK turns.
    for (var i = first; i < min(first + SCAN_CHUNK, loss.n_partials); i++) {
        mine += partials[i];
    }
    let sum = workgroup_sum(thread.local, mine);
    if (thread.local == 0u && block * BLOCK < loss.n_partials) {
        block_partials[block] = sum;
    }
}

@compute @workgroup_size(WORKGROUP)
fn loss_total(thread: Thread) {
    let n_blocks = (loss.n_partials + BLOCK - 1u) / BLOCK;
    let chunk = (n_blocks + WORKGROUP - 1u) / WORKGROUP;
    var mine = vec2f(0.0);
    // bound: n_partials / (SCAN_CHUNK WORKGROUP^2) + 1 turns: 2^15 for 2^32 partials.
    for (var i = thread.local * chunk; i < min((thread.local + 1u) * chunk, n_blocks); i++) {
        mine += block_partials[i];
    }
    let sum = workgroup_sum(thread.local, mine);
    if (thread.local == 0u) {
        losses[loss.slot] = loss.mean_scale * sum.yx;
    }
}
