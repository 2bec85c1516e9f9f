// Turns counts into prefix sums on GPUs: the threads of a workgroup add its sums up as a tree.
#import shared/radix_group
#import shared/scan

// Exclusive sums over the workgroup in `sums`; returns the total.
fn scan_workgroup(local: u32) -> u32 {
    // bound: 6 turns, `step` doubles up to WORKGROUP.
    for (var step = 1u; step < WORKGROUP; step *= 2u) {
        workgroupBarrier();
        let before = select(0u, sums[max(local, step) - step], local >= step);
        workgroupBarrier();
        sums[local] = saturating_add(before, sums[local]);
    }
    workgroupBarrier();
    let total = sums[WORKGROUP - 1u];
    let before = select(0u, sums[max(local, 1u) - 1u], local > 0u);
    workgroupBarrier();
    sums[local] = before;
    return total;
}
