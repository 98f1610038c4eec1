//! Pairs of frames from a few bytes: any size, pixel type, memory layout and content.

use arbitrary::Arbitrary;
use lk_core::Pixel;
use ndarray::{Array2, ArrayView2, s};

/// What a frame shows.
#[derive(Debug, Clone, Arbitrary)]
pub enum Content {
    /// Plane waves from a seed, moved and lit: the motion is known.
    Scene(u16),
    /// Two frames of unrelated grey levels.
    Noise(u16),
    /// The same noise twice.
    Still(u16),
    /// One grey level.
    Flat(u8),
    /// Stripes of this period, which moved along themselves and across.
    Stripes(u8),
    /// These grey levels, repeated.
    Bytes(Vec<u8>),
}

/// Grey levels that no camera gives; only `f32` holds them.
#[derive(Debug, Clone, Copy, Arbitrary)]
pub enum Odd {
    /// Not a number.
    Nan,
    /// Positive infinity.
    Infinite,
    /// The largest negative number.
    Lowest,
    /// The largest number.
    Largest,
    /// The smallest one that is not zero.
    Tiny,
}

/// How a frame lies in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Arbitrary)]
pub enum Layout {
    /// Rows without gaps.
    Rows,
    /// Cut out of a larger picture.
    Crop,
    /// Column by column.
    Columns,
    /// Turned by half: both strides are negative.
    Turned,
    /// Every second pixel of every third row.
    Sparse,
}

/// The type of a grey level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Arbitrary)]
pub enum Depth {
    /// `u8`
    Byte,
    /// `u16`
    Deep,
    /// `f32`
    Float,
}

/// A pair of frames.
#[derive(Debug, Clone, Arbitrary)]
pub struct Frames {
    height: u8,
    width: u8,
    content: Content,
    /// In 1/16 px.
    motion: (i8, i8),
    /// In 1/64 beyond 0.5, up to 2.
    gain: u8,
    /// In grey levels of 256.
    offset: i8,
    odd: Vec<(u8, u8, bool, Odd)>,
    /// How both lie in memory.
    pub layout: Layout,
    /// Their pixel type.
    pub depth: Depth,
}

/// The largest side: large enough for several levels, small enough for thousands of cases a minute.
const LARGEST: usize = 96;

impl Frames {
    /// Height and width; sizes of 0 and 1 are among them.
    pub fn size(&self) -> (usize, usize) {
        (
            usize::from(self.height) % (LARGEST + 1),
            usize::from(self.width) % (LARGEST + 1),
        )
    }

    /// Whether both frames are the same.
    pub fn still(&self) -> bool {
        matches!(
            self.content,
            Content::Still(_) | Content::Flat(_) | Content::Bytes(_)
        ) && self.odd.is_empty()
    }

    /// Whether no grey level is at an end of what its type holds: a stream reads a frame at the scale of the one before.
    pub fn in_range(&self) -> bool {
        !self
            .odd
            .iter()
            .any(|(.., odd)| matches!(odd, Odd::Lowest | Odd::Largest | Odd::Tiny))
    }

    /// The motion, where the frames are a scene whose grey levels this pixel type holds.
    pub fn truth(&self) -> Option<[f64; 2]> {
        let Content::Scene(_) = self.content else {
            return None;
        };
        let most = match self.depth {
            Depth::Byte => 254.0,
            Depth::Deep => 65_000.0,
            Depth::Float => f64::INFINITY,
        };
        let held = |frame: &Array2<f64>| frame.iter().all(|grey| *grey >= 1.0 && *grey <= most);
        let (prev, next) = self.greys();
        let kept =
            self.odd.is_empty() && (self.depth == Depth::Float || held(&prev) && held(&next));
        kept.then(|| self.motion())
    }

    fn motion(&self) -> [f64; 2] {
        [
            f64::from(self.motion.0) / 16.0,
            f64::from(self.motion.1) / 16.0,
        ]
    }

    /// The grey levels before they are rounded to a pixel type.
    fn greys(&self) -> (Array2<f64>, Array2<f64>) {
        let size = self.size();
        let [dx, dy] = self.motion();
        let gain = 0.5 + f64::from(self.gain % 97) / 64.0;
        let offset = f64::from(self.offset);
        let lit = |frame: Array2<f64>| frame.mapv(|grey| gain * grey + offset);
        match &self.content {
            Content::Scene(seed) => {
                let scene = waves(*seed);
                let prev = Array2::from_shape_fn(size, |(y, x)| scene(x as f64, y as f64));
                let next =
                    Array2::from_shape_fn(size, |(y, x)| scene(x as f64 - dx, y as f64 - dy));
                (prev, lit(next))
            }
            Content::Noise(seed) => (
                noise(size, u64::from(*seed)),
                noise(size, u64::from(*seed) + (1 << 20)),
            ),
            Content::Still(seed) => (noise(size, u64::from(*seed)), noise(size, u64::from(*seed))),
            Content::Flat(grey) => {
                let flat = Array2::from_elem(size, f64::from(*grey));
                (flat.clone(), flat)
            }
            Content::Stripes(period) => {
                let wave = std::f64::consts::TAU / (2.0 + f64::from(*period) / 8.0);
                let at = |x: f64| 100.0 + 60.0 * (wave * x).sin();
                let prev = Array2::from_shape_fn(size, |(_, x)| at(x as f64));
                (
                    prev,
                    lit(Array2::from_shape_fn(size, |(_, x)| at(x as f64 - dx))),
                )
            }
            Content::Bytes(bytes) => {
                let mut greys = bytes.iter().cycle();
                let frame = Array2::from_shape_simple_fn(size, || {
                    greys.next().map_or(0.0, |grey| f64::from(*grey))
                });
                (frame.clone(), frame)
            }
        }
    }

    /// Both frames of pixel type `T`.
    pub fn pair<T: Grey>(&self) -> (Laid<T>, Laid<T>) {
        let (prev, next) = self.greys();
        let (mut prev, mut next) = (prev.mapv(T::of), next.mapv(T::of));
        let (height, width) = self.size();
        if height > 0 && width > 0 {
            for (y, x, first, odd) in &self.odd {
                let frame = if *first { &mut prev } else { &mut next };
                let at = (usize::from(*y) % height, usize::from(*x) % width);
                if let Some(value) = T::odd(*odd) {
                    frame[at] = value;
                }
            }
        }
        (Laid::new(&prev, self.layout), Laid::new(&next, self.layout))
    }
}

/// Forty plane waves of 6 to 60 px length: nothing repeats within a frame.
fn waves(seed: u16) -> impl Fn(f64, f64) -> f64 {
    let mut random = generator(u64::from(seed));
    let waves: Vec<[f64; 4]> = (0..40)
        .map(|_| {
            let frequency = 0.1 + 0.9 * random();
            let angle = std::f64::consts::TAU * random();
            [
                frequency * angle.cos(),
                frequency * angle.sin(),
                std::f64::consts::TAU * random(),
                3.0 + 6.0 * random(),
            ]
        })
        .collect();
    move |x, y| {
        120.0
            + waves
                .iter()
                .map(|[a, b, phase, height]| height * (a * x + b * y + phase).sin())
                .sum::<f64>()
    }
}

fn noise(size: (usize, usize), seed: u64) -> Array2<f64> {
    let mut random = generator(seed);
    Array2::from_shape_simple_fn(size, || (256.0 * random()).floor())
}

/// Numbers from 0 to 1: Knuth's 64-bit linear congruence.
fn generator(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1_u32 << 31)
    }
}

/// A pixel type that can be made from a grey level.
pub trait Grey: Pixel + Default {
    /// The nearest value.
    fn of(grey: f64) -> Self;

    /// An odd value, where the type has one.
    fn odd(odd: Odd) -> Option<Self>;
}

impl Grey for u8 {
    fn of(grey: f64) -> Self {
        grey.round() as Self
    }

    fn odd(_: Odd) -> Option<Self> {
        None
    }
}

impl Grey for u16 {
    fn of(grey: f64) -> Self {
        grey.round() as Self
    }

    fn odd(_: Odd) -> Option<Self> {
        None
    }
}

impl Grey for f32 {
    fn of(grey: f64) -> Self {
        grey as Self
    }

    fn odd(odd: Odd) -> Option<Self> {
        Some(match odd {
            Odd::Nan => Self::NAN,
            Odd::Infinite => Self::INFINITY,
            Odd::Lowest => Self::MIN,
            Odd::Largest => Self::MAX,
            Odd::Tiny => Self::from_bits(1),
        })
    }
}

/// A frame in some memory layout.
pub struct Laid<T> {
    memory: Array2<T>,
    layout: Layout,
    size: (usize, usize),
}

impl<T: Grey> Laid<T> {
    fn new(frame: &Array2<T>, layout: Layout) -> Self {
        let size = frame.dim();
        let mut laid = Self {
            memory: Array2::default(memory_size(size, layout)),
            layout,
            size,
        };
        for (at, value) in frame.indexed_iter() {
            laid.memory[place(at, size, layout)] = *value;
        }
        laid
    }

    /// The frame, as it lies.
    pub fn view(&self) -> ArrayView2<'_, T> {
        let (height, width) = self.size;
        match self.layout {
            Layout::Rows => self.memory.view(),
            Layout::Crop => self.memory.slice(s![3..3 + height, 5..5 + width]),
            Layout::Columns => self.memory.t(),
            Layout::Turned => self.memory.slice(s![..;-1, ..;-1]),
            Layout::Sparse => self.memory.slice(s![..;3, ..;2]),
        }
    }

    /// The same pixels in rows without gaps.
    pub fn rows(&self) -> Array2<T> {
        let size = self.size;
        Array2::from_shape_fn(size, |at| self.memory[place(at, size, self.layout)])
    }
}

fn memory_size((height, width): (usize, usize), layout: Layout) -> (usize, usize) {
    match layout {
        Layout::Rows | Layout::Turned => (height, width),
        Layout::Crop => (height + 7, width + 9),
        Layout::Columns => (width, height),
        Layout::Sparse => (3 * height, 2 * width),
    }
}

fn place(
    (y, x): (usize, usize),
    (height, width): (usize, usize),
    layout: Layout,
) -> (usize, usize) {
    match layout {
        Layout::Rows => (y, x),
        Layout::Crop => (y + 3, x + 5),
        Layout::Columns => (x, y),
        Layout::Turned => (height - 1 - y, width - 1 - x),
        Layout::Sparse => (3 * y, 2 * x),
    }
}

/// A mask, or none: with holes anywhere, a part at one side, a frame around, or a hole within.
pub fn mask(size: (usize, usize), seed: Option<u16>) -> Option<Array2<bool>> {
    let seed = seed?;
    let mut random = generator(u64::from(seed));
    let share = random();
    if seed % 4 == 0 {
        return Some(Array2::from_shape_simple_fn(size, || random() < share));
    }
    let (down, across) = (share * size.0 as f64, random() * size.1 as f64);
    Some(Array2::from_shape_fn(size, |(y, x)| {
        let (y, x) = (y as f64, x as f64);
        match seed % 4 {
            1 => y < down,
            2 => y >= down && x >= across,
            _ => (y - down).abs() > 0.3 * size.0 as f64 || (x - across).abs() > 7.0,
        }
    }))
}

/// A frame whose pixels that a mask takes away are others: whatever they show, nothing may depend on it.
pub fn covered<T: Grey>(frame: &Array2<T>, mask: Option<&Array2<bool>>, seed: u64) -> Array2<T> {
    let mut random = generator(seed);
    let mut covered = frame.clone();
    let Some(mask) = mask else { return covered };
    for (value, keep) in covered.iter_mut().zip(mask) {
        let chance = random();
        let odd = [
            Odd::Nan,
            Odd::Infinite,
            Odd::Lowest,
            Odd::Largest,
            Odd::Tiny,
        ];
        if !keep {
            *value = T::odd(odd[(chance * 64.0) as usize % odd.len()])
                .filter(|_| chance < 0.5)
                .unwrap_or_else(|| T::of((256.0 * random()).floor()));
        }
    }
    covered
}
