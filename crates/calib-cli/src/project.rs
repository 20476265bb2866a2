//! `calib project`: pixels to the floor and points of space to pixels, as CSV, row by row.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

use calib_core::{Camera, FloorPoint, Pixel, SiteCamera, WorldPoint, default_efov, efov_on_floor};
use clap::ValueEnum;
use csv::StringRecord;

use crate::args::SiteArgs;
use crate::files;
use crate::stop::Stop;

/// Which way to map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum To {
    /// Columns `u,v` to `x_m,y_m,status`
    Floor,
    /// Columns `x_m,y_m,z_m` to `u,v,status`
    Pixel,
}

/// Arguments of `calib project`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Which camera
    #[arg(long, value_name = "ID")]
    camera: String,
    /// Which way to map
    #[arg(long, value_enum)]
    to: To,
    /// Height of the plane above the floor, in metres; with --to pixel, where there is no `z_m`
    #[arg(long, value_name = "H", default_value_t = 0.0, allow_negative_numbers = true)]
    height_m: f64,
    /// Input CSV with a header; - is stdin
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    input: String,
    /// Output CSV; - is stdout
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    output: String,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Maps every row of a CSV table.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    if !args.height_m.is_finite() {
        return Err(Stop::Usage("--height-m: expected a number of metres".into()));
    }
    let file = args.site.read()?;
    file.camera(&args.camera)?;
    let file = file.solved();
    let view = View::of(file.camera(&args.camera)?)?;
    let input: Box<dyn Read> = match args.input.as_str() {
        "-" => Box::new(std::io::stdin().lock()),
        path => Box::new(BufReader::new(File::open(path).map_err(|error| Stop::invalid(path, error))?)),
    };
    let name = if args.input == "-" { "stdin" } else { &args.input };
    if args.output == "-" {
        return table(&view, args, name, input, BufWriter::new(std::io::stdout().lock()));
    }
    files::check_free(&args.output, args.force)?;
    files::write_through(Path::new(&args.output), |file| {
        table(&view, args, name, input, BufWriter::new(file))
    })
}

/// A solved camera with what tells the status of a pixel.
struct View {
    camera: Camera,
    size: [f64; 2],
    efov: Vec<FloorPoint>,
}

impl View {
    fn of(entry: &SiteCamera) -> Result<Self, Stop> {
        let camera = entry.camera().ok_or_else(|| {
            let why =
                entry.error.as_ref().map_or_else(|| "only its lens is known".into(), ToString::to_string);
            Stop::Unsolved(format!("camera \"{}\" is not calibrated: {why}", entry.id))
        })?;
        // A solution from elsewhere may come without its polygon on the floor.
        let efov = match (&entry.solution, &entry.efov_px) {
            (Some(solution), _) if !solution.efov_m.is_empty() => solution.efov_m.clone(),
            (_, Some(corners)) => efov_on_floor(&camera, corners).polygon,
            _ => default_efov(&camera, entry.size()).polygon,
        };
        Ok(Self { camera, size: entry.size(), efov })
    }

    fn shows(&self, pixel: Pixel) -> bool {
        let [w, h] = self.size;
        pixel.u >= 0.0 && pixel.v >= 0.0 && pixel.u <= w && pixel.v <= h
    }

    fn to_floor(&self, pixel: Pixel, height: f64) -> (Option<FloorPoint>, &'static str) {
        if self.camera.undistort(pixel).is_none() {
            return (None, "outside-lens");
        }
        let Some(point) = self.camera.pixel_to_floor(pixel, height) else { return (None, "above-horizon") };
        let on_floor = if height == 0.0 { Some(point) } else { self.camera.pixel_to_floor(pixel, 0.0) };
        let status = match on_floor {
            _ if !self.shows(pixel) => "outside-image",
            Some(floor) if contains(&self.efov, floor) => "ok",
            _ => "outside-efov",
        };
        (Some(point), status)
    }

    fn to_pixel(&self, point: WorldPoint) -> (Option<Pixel>, &'static str) {
        let Some(straight) = self.camera.world_to_undistorted(point) else { return (None, "behind-camera") };
        match self.camera.distort(straight) {
            None => (None, "outside-lens"),
            Some(pixel) if self.shows(pixel) => (Some(pixel), "ok"),
            Some(pixel) => (Some(pixel), "outside-image"),
        }
    }
}

/// Whether a point lies inside a polygon (even-odd rule).
fn contains(polygon: &[FloorPoint], point: FloorPoint) -> bool {
    (0..polygon.len()).fold(false, |inside, i| {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        let crosses =
            (a.y > point.y) != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x);
        inside != crosses
    })
}

/// Where the columns are that are read and written.
struct Columns {
    header: StringRecord,
    read: [Option<usize>; 3],
    write: [usize; 3],
}

impl Columns {
    fn new(header: &StringRecord, to: To, name: &str) -> Result<Self, Stop> {
        let (inputs, needed, outputs): (&[&str], usize, [&str; 3]) = match to {
            To::Floor => (&["u", "v"], 2, ["x_m", "y_m", "status"]),
            To::Pixel => (&["x_m", "y_m", "z_m"], 2, ["u", "v", "status"]),
        };
        let position = |wanted: &str| header.iter().position(|column| column.trim() == wanted);
        let mut read = [None; 3];
        for (i, column) in inputs.iter().enumerate() {
            read[i] = position(column);
            if read[i].is_none() && i < needed {
                let found: Vec<&str> = header.iter().collect();
                let what = format!(
                    "line 1: found the columns \"{}\", expected {}",
                    found.join(","),
                    inputs.join(",")
                );
                return Err(Stop::invalid(name, what));
            }
        }
        // A column that is there already is written anew in its place.
        let mut header = header.clone();
        let write = outputs.map(|column| {
            position(column).unwrap_or_else(|| {
                header.push_field(column);
                header.len() - 1
            })
        });
        Ok(Self { header, read, write })
    }
}

fn table(view: &View, args: &Args, name: &str, input: impl Read, output: impl Write) -> Result<(), Stop> {
    let mut reader = csv::ReaderBuilder::new().from_reader(input);
    let mut writer = csv::Writer::from_writer(output);
    let broken = |error: csv::Error| match error.kind() {
        csv::ErrorKind::Io(_) => Stop::from(error),
        _ => Stop::invalid(name, error),
    };
    let columns = Columns::new(reader.headers().map_err(broken)?, args.to, name)?;
    writer.write_record(&columns.header)?;
    let mut record = StringRecord::new();
    let mut fields: Vec<String> = Vec::new();
    while reader.read_record(&mut record).map_err(broken)? {
        fields.clear();
        fields.extend(record.iter().map(str::to_owned));
        fields.resize(columns.header.len(), String::new());
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: usize| {
            let text = record.get(column).unwrap_or_default().trim();
            text.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(|| {
                let title = columns.header.get(column).unwrap_or_default();
                Stop::invalid(
                    name,
                    format!("line {line}, column {title}: found \"{text}\", expected a number"),
                )
            })
        };
        let value = |i: usize| columns.read[i].map_or(Ok(args.height_m), number);
        let (mapped, status) = match args.to {
            To::Floor => {
                let (point, status) = view.to_floor(Pixel { u: value(0)?, v: value(1)? }, args.height_m);
                (point.map(<[f64; 2]>::from), status)
            }
            To::Pixel => {
                let (pixel, status) = view.to_pixel(WorldPoint { x: value(0)?, y: value(1)?, z: value(2)? });
                (pixel.map(<[f64; 2]>::from), status)
            }
        };
        for i in 0..2 {
            fields[columns.write[i]] = mapped.map_or_else(String::new, |point| point[i].to_string());
        }
        status.clone_into(&mut fields[columns.write[2]]);
        writer.write_record(&fields)?;
    }
    writer.flush()?;
    Ok(())
}
