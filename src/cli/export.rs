//! This is the command `gspotential export`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};

use crate::error::Result;
use crate::pipeline::{self, Distance, ExportJob, Size};

const EXAMPLES: &str = "\
Examples:
  gspotential export runs/garden --out garden.spz
  gspotential export runs/garden --out garden.glb
  gspotential export garden/point_cloud.ply --out garden.splat
  gspotential export runs/garden --measure --out garden.spz --out garden.splat --out garden.sog
  gspotential export runs/garden --mesh --out garden.obj
  gspotential export runs/garden --metres a.jpg:b.jpg=1.35 --out garden.ply --cameras garden.json

.spz     about a tenth of the PLY, with all SH degrees in 8 bits a value
.sog     PlayCanvas' format for the web: 256 scales and colours, a palette of the other SH
.splat   32 bytes a Gaussian and the colours of degree 0
.glb     glTF with KHR_gaussian_splatting, f32, y up; .gltf is the same as text. Programs that do
         not know the extension show points
.ply     the layout of 3DGS, as point_cloud.ply of a run, which viewers open as it is. With --lean
         without normals and empty SH degrees: viewers on the web read that, 3DGS's own does not

--mesh writes a surface mesh with a colour a vertex as .ply, .obj, .glb or .gltf instead: depth of
the training and virtual views, fused in a grid around what the training views see within the sphere
that they stand on. What no view saw stays open, and pieces of less than a thousandth of the mesh
are left out.";

/// Write a trained scene in the formats of other programs, or a surface mesh of it
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, group = ArgGroup::new("size"))]
pub(crate) struct ExportArgs {
    /// Run directory, or Gaussians in the 3DGS PLY layout
    #[arg(value_name = "RUN|FILE.ply")]
    model: PathBuf,

    /// File to write, .spz, .sog, .splat, .glb, .gltf or .ply, with --mesh .ply, .obj, .glb or .gltf; one of
    /// the same name is replaced. May be given again
    #[arg(long, value_name = "FILE", required = true)]
    out: Vec<PathBuf>,

    /// Write metres, by the distance between two of the run's cameras
    #[arg(long, value_name = "VIEW:VIEW=LENGTH", group = "size")]
    metres: Option<Distance>,

    /// Multiply all lengths by FACTOR
    #[arg(long, value_name = "FACTOR", group = "size")]
    scale: Option<f64>,

    /// Multiply all lengths by the power of 2 from which viewers with a near plane of 0.2 cut off
    /// nothing that the run's cameras see
    #[arg(long, group = "size")]
    viewer_safe: bool,

    /// Write the run's cameras, too, in the unit of the files and in the frame of all but glTF
    #[arg(long, value_name = "FILE.json")]
    cameras: Option<PathBuf>,

    /// Leave properties that say nothing out of a .ply
    #[arg(long)]
    lean: bool,

    /// Print what each file costs: its size, and the PSNR of its renders against those of the model
    /// at the run's training and test views
    #[arg(long)]
    measure: bool,

    /// Write a surface mesh instead of the Gaussians
    #[arg(long)]
    mesh: bool,

    /// Voxels along the longest side of the mesh's grid: 20 bytes each, and time with their cube
    #[arg(long, value_name = "N", default_value_t = 256, requires = "mesh",
          value_parser = clap::value_parser!(u32).range(16..=4096))]
    mesh_voxels: u32,
}

impl ExportArgs {
    pub(crate) fn run(self) -> Result<()> {
        let table = pipeline::export(&ExportJob {
            model: self.model,
            out: self.out,
            size: match (self.metres, self.scale, self.viewer_safe) {
                (Some(distance), ..) => Size::Metres(distance),
                (_, Some(factor), _) => Size::Factor(factor),
                (.., true) => Size::ViewerSafe,
                _ => Size::AsItIs,
            },
            lean: self.lean,
            cameras: self.cameras,
            measure: self.measure,
            mesh: self.mesh.then_some(self.mesh_voxels),
        })?;
        match table {
            Some(table) => super::print(&format!("{table}\n")),
            None => Ok(()),
        }
    }
}
