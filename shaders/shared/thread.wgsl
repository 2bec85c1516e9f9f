// One thread of a dispatch. The host folds the workgroups into rows, because a side of the grid ends
// at 65,535 of them.
struct Thread {
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) n_workgroups: vec3u,
    // Number within the workgroup.
    @builtin(local_invocation_index) local: u32,
}

// The number of the thread's workgroup.
fn workgroup_index(thread: Thread) -> u32 {
    return thread.workgroup.y * thread.n_workgroups.x + thread.workgroup.x;
}

// The thread's number in the whole dispatch.
fn thread_index(thread: Thread) -> u32 {
    return workgroup_index(thread) * WORKGROUP + thread.local;
}
