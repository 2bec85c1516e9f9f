// Turns counts into prefix sums on drivers that run on a CPU: one thread adds the sums of its workgroup up, which is less
// work than a tree.
#import shared/radix_thread
#import shared/scan

var<workgroup> block_total: u32;

// Exclusive sums over the workgroup in `sums`; returns the total.
fn scan_workgroup(local: u32) -> u32 {
    workgroupBarrier();
    if (local == 0u) {
        var sum = 0u;
        // bound: WORKGROUP turns.
        for (var i = 0u; i < WORKGROUP; i++) {
            let s = sums[i];
            sums[i] = sum;
            sum = saturating_add(sum, s);
        }
        block_total = sum;
    }
    workgroupBarrier();
    return block_total;
}
