//! The Gaussians' parameters on the GPU.

use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::{Buffer, BufferKind, Gpu};

/// Planes of four floats a Gaussian: geometry, and SH blocks of degrees 0-1, 2 and 3. A block
/// stays within one binding up to 1.6 million Gaussians on adapters that bind 128 MiB.
pub const BLOCK_PLANES: [usize; 4] = [3, 3, 4, 5];

/// The blocks, with a `vec4f` a Gaussian and plane.
const BLOCKS: [BufferKind; 4] = [
    BufferKind::storage::<[f32; 4]>("geometry"),
    BufferKind::storage::<[f32; 4]>("sh_0"),
    BufferKind::storage::<[f32; 4]>("sh_2"),
    BufferKind::storage::<[f32; 4]>("sh_3"),
];

/// Returns the entries of block `i`; 0 if the degree needs none.
fn block_len(i: usize, stride: usize, sh_degree: u32) -> usize {
    match i < n_blocks(sh_degree) {
        true => BLOCK_PLANES[i] * stride,
        false => 0,
    }
}

/// Returns the bytes of a [`Model`].
pub fn model_bytes(stride: usize, sh_degree: u32) -> u64 {
    (0..BLOCKS.len())
        .map(|i| one_block_bytes(i, stride, sh_degree))
        .sum()
}

/// Returns the bytes of the largest of its blocks.
pub fn block_bytes(stride: usize, sh_degree: u32) -> u64 {
    let used = 0..n_blocks(sh_degree);
    let bytes = used.map(|i| one_block_bytes(i, stride, sh_degree));
    bytes.max().unwrap_or(0)
}

fn one_block_bytes(i: usize, stride: usize, sh_degree: u32) -> u64 {
    BLOCKS[i].bytes(block_len(i, stride, sh_degree))
}

/// Parameter blocks (or Adam moments of the same shape), `[plane][stride]` of `vec4f` each.
///
/// Geometry planes: `mean.xyz, opacity_logit`; `scale_log.xyz, density`, which guides
/// dropout alone; `rotation_wxyz`. SH planes:
/// float `3k + c` of a Gaussian is coefficient `k` of channel `c`, four floats a plane.
pub struct Model {
    /// Gaussians; entries from `n` on are room.
    pub n: usize,
    /// Entries a plane; at least `n`.
    pub stride: usize,
    /// Degree up to which coefficients are stored.
    pub sh_degree: u32,
    /// Geometry, and SH of degrees 0-1, 2 and 3, `4 * BLOCK_PLANES[i] * stride` floats each; blocks
    /// that the degree does not need are placeholders.
    pub blocks: [Buffer; 4],
}

impl Model {
    /// Allocates blocks of zeros with room for `stride` Gaussians, of which there are `n`.
    ///
    /// # Errors
    /// A block is larger than the adapter can bind, or memory runs out.
    pub fn zeros(gpu: &Gpu, n: usize, stride: usize, sh_degree: u32) -> Result<Model> {
        let block = |i: usize| BLOCKS[i].allocate(gpu, block_len(i, stride, sh_degree));
        Ok(Model {
            n,
            stride,
            sh_degree,
            blocks: [block(0)?, block(1)?, block(2)?, block(3)?],
        })
    }

    /// Returns the blocks under their names in the shaders.
    pub(super) fn names(&self) -> impl Iterator<Item = (&'static str, &Buffer)> {
        BLOCKS.iter().map(BufferKind::name).zip(&self.blocks)
    }

    /// Uploads Gaussians, with room for `stride` of them and every density 0.
    ///
    /// # Errors
    /// As [`Model::zeros`].
    pub fn upload(gpu: &Gpu, gaussians: &Gaussians, stride: usize) -> Result<Model> {
        let n = gaussians.means.len();
        let model = Self::zeros(gpu, n, stride, gaussians.sh_degree)?;
        let mut geometry = vec![[0.0_f32; 4]; 3 * stride];
        for i in 0..n {
            let mean = gaussians.means[i];
            let scale = gaussians.scales_log[i];
            geometry[i] = [mean.x, mean.y, mean.z, gaussians.opacity_logits[i]];
            geometry[stride + i] = [scale.x, scale.y, scale.z, 0.0];
            geometry[2 * stride + i] = gaussians.rotations_wxyz[i];
        }
        model.blocks[0].write(gpu, &geometry);
        model.write_sh(gpu, gaussians);
        Ok(model)
    }

    /// Writes the SH coefficients of Gaussians, of which there are as many and of the same degree.
    pub fn write_sh(&self, gpu: &Gpu, gaussians: &Gaussians) {
        let (n, stride) = (gaussians.len(), self.stride);
        let n_sh = n_floats(gaussians.sh_degree);
        let mut first = 0;
        let n_blocks_sh = n_blocks(gaussians.sh_degree);
        for (buffer, n_planes) in self
            .blocks
            .iter()
            .zip(BLOCK_PLANES)
            .take(n_blocks_sh)
            .skip(1)
        {
            let mut planes = vec![[0.0_f32; 4]; n_planes * stride];
            for i in 0..n {
                let sh = &gaussians.sh[i * n_sh..][..n_sh];
                for (f, &value) in sh[first..].iter().take(4 * n_planes).enumerate() {
                    planes[f / 4 * stride + i][f % 4] = value;
                }
            }
            buffer.write(gpu, &planes);
            first += 4 * n_planes;
        }
    }

    /// Reads the means back, in the frame that they were uploaded in.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn means(&self, gpu: &Gpu) -> Result<Vec<glam::Vec3>> {
        let plane: Vec<[f32; 4]> = self.blocks[0].read(gpu, self.n)?;
        Ok(plane.iter().map(xyz).collect())
    }

    /// Writes the density of every Gaussian, which guided dropout looks at.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn set_densities(&self, gpu: &Gpu, densities: &[f32]) -> Result<()> {
        let mut geometry: Vec<[f32; 4]> = self.blocks[0].read(gpu, 3 * self.stride)?;
        for (scale, density) in geometry[self.stride..].iter_mut().zip(densities) {
            scale[3] = *density;
        }
        self.blocks[0].write(gpu, &geometry);
        Ok(())
    }

    /// Reads the Gaussians back.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn download(&self, gpu: &Gpu) -> Result<Gaussians> {
        self.read_up_to(gpu, self.sh_degree)
    }

    /// Reads the Gaussians back with the colours of degree 0 alone.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn download_base(&self, gpu: &Gpu) -> Result<Gaussians> {
        self.read_up_to(gpu, 0)
    }

    /// Reads the Gaussians back with coefficients up to `sh_degree`, at most the model's own.
    fn read_up_to(&self, gpu: &Gpu, sh_degree: u32) -> Result<Gaussians> {
        let (n, stride) = (self.n, self.stride);
        let geometry: Vec<[f32; 4]> = self.blocks[0].read(gpu, 3 * stride)?;
        let n_sh = n_floats(sh_degree);
        let mut sh = vec![0.0; n * n_sh];
        let mut first = 0;
        let n_blocks_sh = n_blocks(sh_degree);
        for (buffer, n_planes) in self
            .blocks
            .iter()
            .zip(BLOCK_PLANES)
            .take(n_blocks_sh)
            .skip(1)
        {
            let planes: Vec<[f32; 4]> = buffer.read(gpu, n_planes * stride)?;
            for i in 0..n {
                let sh = &mut sh[i * n_sh..][..n_sh];
                for (f, value) in sh[first..].iter_mut().take(4 * n_planes).enumerate() {
                    *value = planes[f / 4 * stride + i][f % 4];
                }
            }
            first += 4 * n_planes;
        }
        Ok(Gaussians {
            means: geometry[..n].iter().map(xyz).collect(),
            opacity_logits: geometry[..n].iter().map(|v| v[3]).collect(),
            scales_log: geometry[stride..][..n].iter().map(xyz).collect(),
            rotations_wxyz: geometry[2 * stride..][..n].to_vec(),
            sh,
            sh_degree,
        })
    }
}

fn xyz(v: &[f32; 4]) -> glam::Vec3 {
    glam::Vec3::new(v[0], v[1], v[2])
}

/// Returns the most Gaussians of a degree whose every block the adapter can bind.
pub fn most_gaussians(gpu: &Gpu, sh_degree: u32) -> usize {
    let planes = BLOCK_PLANES[..n_blocks(sh_degree)].iter().max();
    (gpu.max_binding() / (16 * planes.copied().unwrap_or(1) as u64)) as usize
}

/// Returns the SH floats of one Gaussian.
fn n_floats(sh_degree: u32) -> usize {
    3 * (sh_degree as usize + 1).pow(2)
}

/// Returns the blocks in use: geometry and those that hold coefficients up to `sh_degree`.
pub fn n_blocks(sh_degree: u32) -> usize {
    match sh_degree {
        0 | 1 => 2,
        2 => 3,
        _ => 4,
    }
}
