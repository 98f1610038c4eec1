//! Eight `f32` side by side, in whatever registers a level has.
//!
//! Where a kernel keeps many sums in registers, the compiler does not turn plain loops into vector code; it writes
//! its body over [`Eight`] instead. The count is fixed at eight, so that a sum over lanes has one order on every CPU
//! level; sixteen would leave more of a window's rows to padding than they gain.

use std::ops::{Add, AddAssign, Mul, Sub};

use super::SimdLevel;

/// Eight of one [`Eight`].
pub(crate) const EIGHT: usize = 8;

/// Eight values in memory.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub(crate) struct Packed(pub(crate) [f32; EIGHT]);

impl Packed {
    pub(crate) const ZERO: Self = Self([0.0; EIGHT]);

    /// 0, 1, ...
    pub(crate) const STEPS: Self = Self([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);

    /// The sum over lanes, in a fixed order.
    #[inline(always)]
    pub(crate) fn sum(self) -> f64 {
        let [a, b, c, d, e, f, g, h] = self.0;
        f64::from(((a + e) + (c + g)) + ((b + f) + (d + h)))
    }
}

/// [`Eight::first`] of any count, from one place or another on.
static FIRST: [f32; 2 * EIGHT] = {
    let mut masks = [0.0; 2 * EIGHT];
    let mut lane = 0;
    while lane < EIGHT {
        masks[lane] = f32::from_bits(u32::MAX);
        lane += 1;
    }
    masks
};

/// Eight `f32` in registers; arithmetic is element by element.
pub(crate) trait Eight:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + AddAssign
{
    /// The same value in every lane.
    fn splat(value: f32) -> Self;

    /// The values from `at` on.
    fn load(from: &[f32], at: usize) -> Self;

    /// Write to the values from `at` on.
    fn store(self, to: &mut [f32], at: usize);

    /// From memory.
    fn unpack(from: &Packed) -> Self;

    /// To memory.
    fn pack(self) -> Packed;

    /// All bits set in the first `count` lanes, none in the others: a mask for [`Eight::keep`].
    #[inline(always)]
    fn first(count: usize) -> Self {
        Self::load(&FIRST, EIGHT - count.min(EIGHT))
    }

    /// Keep the bits of `mask`: all of a lane or none, whatever it holds.
    fn keep(self, mask: Self) -> Self;

    /// All bits set in the lanes that are not less than those of `other`, none where either is NaN: a mask.
    fn mask_from(self, other: Self) -> Self;

    /// The lanes of `set` where all bits of this mask are set, of `clear` where none is.
    fn choose(self, set: Self, clear: Self) -> Self;

    /// The square roots.
    fn sqrt(self) -> Self;

    /// The larger of both; that of `other` where either is NaN.
    fn larger(self, other: Self) -> Self;

    /// Which lanes are not less than those of `other`, one bit each; none where either is NaN.
    fn at_least(self, other: Self) -> u8;

    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }

    /// The sum over lanes, in the order of [`Packed::sum`].
    #[inline(always)]
    fn sum(self) -> f64 {
        self.pack().sum()
    }

    /// [`Eight::sum`] of each. A closure given to `map` would not be compiled with the level's instructions.
    #[inline(always)]
    fn sums<const N: usize>(lanes: &[Self; N]) -> [f64; N] {
        let mut sums = [0.0; N];
        for (sum, lanes) in sums.iter_mut().zip(lanes) {
            *sum = lanes.sum();
        }
        sums
    }
}

/// The body of a kernel that is written over [`Eight`], once for all levels.
pub(crate) trait EightKernel {
    /// What the kernel returns.
    type Output;

    /// Do the work. Mark the implementation `#[inline(always)]`, and what it calls too, so that lanes stay in
    /// registers.
    fn run<L: Eight>(self) -> Self::Output;
}

/// Run `kernel` with the registers of `level`.
pub(crate) fn dispatch_eight<K: EightKernel>(level: SimdLevel, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        match level.min(SimdLevel::of_this_cpu()) {
            // SAFETY: `of_this_cpu` has found avx512f, bw, dq, vl and avx2 on this CPU.
            SimdLevel::Avx512 => unsafe { run_eight_avx512(kernel) },
            // SAFETY: `of_this_cpu` has found avx2 on this CPU.
            SimdLevel::Avx2 => unsafe { run_eight_avx2(kernel) },
            SimdLevel::Baseline => kernel.run::<x86::Sse>(),
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        let _ = level;
        kernel.run::<Plain>()
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_eight_avx2<K: EightKernel>(kernel: K) -> K::Output {
    kernel.run::<x86::Avx>()
}

/// Eight lanes here too: what AVX-512 adds is twice the registers.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn run_eight_avx512<K: EightKernel>(kernel: K) -> K::Output {
    kernel.run::<x86::Avx>()
}

/// Implement the operators by a method of the same name on a newtype.
macro_rules! operators {
    ($lanes:ty) => {
        impl Add for $lanes {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                self.plus(other)
            }
        }
        impl Sub for $lanes {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.minus(other)
            }
        }
        impl Mul for $lanes {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                self.times(other)
            }
        }
        impl AddAssign for $lanes {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = self.plus(other);
            }
        }
    };
}

/// The lanes as an array, for architectures without intrinsics here, and to test the others against.
#[cfg(any(test, not(target_arch = "x86_64")))]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plain([f32; EIGHT]);

#[cfg(any(test, not(target_arch = "x86_64")))]
impl Plain {
    #[inline(always)]
    fn zip(mut self, other: Self, operator: impl Fn(f32, f32) -> f32) -> Self {
        for (lane, other) in self.0.iter_mut().zip(other.0) {
            *lane = operator(*lane, other);
        }
        self
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

#[cfg(any(test, not(target_arch = "x86_64")))]
operators!(Plain);

#[cfg(any(test, not(target_arch = "x86_64")))]
impl Eight for Plain {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; EIGHT])
    }

    #[inline(always)]
    fn load(from: &[f32], at: usize) -> Self {
        let mut lanes = [0.0; EIGHT];
        lanes.copy_from_slice(&from[at..at + EIGHT]);
        Self(lanes)
    }

    #[inline(always)]
    fn store(self, to: &mut [f32], at: usize) {
        to[at..at + EIGHT].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn unpack(from: &Packed) -> Self {
        Self(from.0)
    }

    #[inline(always)]
    fn pack(self) -> Packed {
        Packed(self.0)
    }

    #[inline(always)]
    fn keep(self, mask: Self) -> Self {
        self.zip(mask, |value, mask| {
            f32::from_bits(value.to_bits() & mask.to_bits())
        })
    }

    #[inline(always)]
    fn mask_from(self, other: Self) -> Self {
        self.zip(other, |a, b| {
            f32::from_bits(if a >= b { u32::MAX } else { 0 })
        })
    }

    #[inline(always)]
    fn choose(mut self, set: Self, clear: Self) -> Self {
        for (lane, (set, clear)) in self.0.iter_mut().zip(set.0.into_iter().zip(clear.0)) {
            let mask = lane.to_bits();
            *lane = f32::from_bits(set.to_bits() & mask | clear.to_bits() & !mask);
        }
        self
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for lane in &mut self.0 {
            *lane = lane.sqrt();
        }
        self
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> u8 {
        let mut bits = 0;
        for (lane, (a, b)) in self.0.into_iter().zip(other.0).enumerate() {
            bits |= u8::from(a >= b) << lane;
        }
        bits
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) mod x86 {
    //! SSE2, which every x86-64 CPU has, and AVX.

    use std::arch::x86_64::{
        __m128, __m256, _CMP_GE_OQ, _mm_add_ps, _mm_add_ss, _mm_and_ps, _mm_andnot_ps,
        _mm_cmpge_ps, _mm_cvtss_f32, _mm_load_ps, _mm_loadu_ps, _mm_max_ps, _mm_movehl_ps,
        _mm_movemask_ps, _mm_mul_ps, _mm_or_ps, _mm_set1_ps, _mm_shuffle_ps, _mm_sqrt_ps,
        _mm_store_ps, _mm_storeu_ps, _mm_sub_ps, _mm256_add_ps, _mm256_and_ps, _mm256_blendv_ps,
        _mm256_castps256_ps128, _mm256_cmp_ps, _mm256_extractf128_ps, _mm256_load_ps,
        _mm256_loadu_ps, _mm256_max_ps, _mm256_movemask_ps, _mm256_mul_ps, _mm256_set1_ps,
        _mm256_sqrt_ps, _mm256_store_ps, _mm256_storeu_ps, _mm256_sub_ps,
    };

    use super::{Add, AddAssign, EIGHT, Eight, Mul, Packed, Sub};

    /// The sum of a, b, c, d as (a + c) + (b + d).
    #[inline(always)]
    fn sum_of_four(four: __m128) -> f32 {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe {
            let pairs = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(pairs, _mm_shuffle_ps::<1>(pairs, pairs)))
        }
    }

    /// The lanes in two SSE registers.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Sse(__m128, __m128);

    impl Sse {
        #[inline(always)]
        fn plus(self, other: Self) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe { Self(_mm_add_ps(self.0, other.0), _mm_add_ps(self.1, other.1)) }
        }

        #[inline(always)]
        fn minus(self, other: Self) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe { Self(_mm_sub_ps(self.0, other.0), _mm_sub_ps(self.1, other.1)) }
        }

        #[inline(always)]
        fn times(self, other: Self) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe { Self(_mm_mul_ps(self.0, other.0), _mm_mul_ps(self.1, other.1)) }
        }
    }

    operators!(Sse);

    impl Eight for Sse {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe { Self(_mm_set1_ps(value), _mm_set1_ps(value)) }
        }

        #[inline(always)]
        fn load(from: &[f32], at: usize) -> Self {
            let from = &from[at..at + EIGHT];
            // SAFETY: the slice holds eight values.
            unsafe {
                Self(
                    _mm_loadu_ps(from.as_ptr()),
                    _mm_loadu_ps(from.as_ptr().add(4)),
                )
            }
        }

        #[inline(always)]
        fn store(self, to: &mut [f32], at: usize) {
            let to = &mut to[at..at + EIGHT];
            // SAFETY: the slice holds eight values.
            unsafe {
                _mm_storeu_ps(to.as_mut_ptr(), self.0);
                _mm_storeu_ps(to.as_mut_ptr().add(4), self.1);
            }
        }

        #[inline(always)]
        fn unpack(from: &Packed) -> Self {
            // SAFETY: `Packed` holds eight values and is aligned to 32 bytes.
            unsafe {
                Self(
                    _mm_load_ps(from.0.as_ptr()),
                    _mm_load_ps(from.0.as_ptr().add(4)),
                )
            }
        }

        #[inline(always)]
        fn pack(self) -> Packed {
            let mut to = Packed::ZERO;
            // SAFETY: `Packed` holds eight values and is aligned to 32 bytes.
            unsafe {
                _mm_store_ps(to.0.as_mut_ptr(), self.0);
                _mm_store_ps(to.0.as_mut_ptr().add(4), self.1);
            }
            to
        }

        #[inline(always)]
        fn keep(self, mask: Self) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe { Self(_mm_and_ps(self.0, mask.0), _mm_and_ps(self.1, mask.1)) }
        }

        #[inline(always)]
        fn mask_from(self, other: Self) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe { Self(_mm_cmpge_ps(self.0, other.0), _mm_cmpge_ps(self.1, other.1)) }
        }

        #[inline(always)]
        fn choose(self, set: Self, clear: Self) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe {
                Self(
                    _mm_or_ps(_mm_and_ps(self.0, set.0), _mm_andnot_ps(self.0, clear.0)),
                    _mm_or_ps(_mm_and_ps(self.1, set.1), _mm_andnot_ps(self.1, clear.1)),
                )
            }
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe { Self(_mm_sqrt_ps(self.0), _mm_sqrt_ps(self.1)) }
        }

        #[inline(always)]
        fn larger(self, other: Self) -> Self {
            // SAFETY: every x86-64 CPU has SSE.
            unsafe { Self(_mm_max_ps(self.0, other.0), _mm_max_ps(self.1, other.1)) }
        }

        #[inline(always)]
        fn sum(self) -> f64 {
            // SAFETY: every x86-64 CPU has SSE.
            f64::from(sum_of_four(unsafe { _mm_add_ps(self.0, self.1) }))
        }

        #[inline(always)]
        fn at_least(self, other: Self) -> u8 {
            // SAFETY: every x86-64 CPU has SSE.
            let (low, high) = unsafe {
                (
                    _mm_movemask_ps(_mm_cmpge_ps(self.0, other.0)),
                    _mm_movemask_ps(_mm_cmpge_ps(self.1, other.1)),
                )
            };
            (low | high << 4) as u8
        }
    }

    /// The lanes in one AVX register.
    ///
    /// Only [`super::dispatch_eight`] names this type, and runs kernels over it where it has found AVX. All
    /// calls of intrinsics below rely on that.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Avx(__m256);

    impl Avx {
        #[inline(always)]
        fn plus(self, other: Self) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }

        #[inline(always)]
        fn minus(self, other: Self) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_sub_ps(self.0, other.0) })
        }

        #[inline(always)]
        fn times(self, other: Self) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_mul_ps(self.0, other.0) })
        }
    }

    operators!(Avx);

    impl Eight for Avx {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_set1_ps(value) })
        }

        #[inline(always)]
        fn load(from: &[f32], at: usize) -> Self {
            let from = &from[at..at + EIGHT];
            // SAFETY: the slice holds eight values; this CPU has AVX, see the type.
            Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
        }

        #[inline(always)]
        fn store(self, to: &mut [f32], at: usize) {
            let to = &mut to[at..at + EIGHT];
            // SAFETY: the slice holds eight values; this CPU has AVX, see the type.
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
        }

        #[inline(always)]
        fn unpack(from: &Packed) -> Self {
            // SAFETY: `Packed` holds eight values aligned to 32 bytes; this CPU has AVX, see the type.
            Self(unsafe { _mm256_load_ps(from.0.as_ptr()) })
        }

        #[inline(always)]
        fn pack(self) -> Packed {
            let mut to = Packed::ZERO;
            // SAFETY: `Packed` holds eight values aligned to 32 bytes; this CPU has AVX, see the type.
            unsafe { _mm256_store_ps(to.0.as_mut_ptr(), self.0) };
            to
        }

        #[inline(always)]
        fn keep(self, mask: Self) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_and_ps(self.0, mask.0) })
        }

        #[inline(always)]
        fn mask_from(self, other: Self) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0) })
        }

        #[inline(always)]
        fn choose(self, set: Self, clear: Self) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_blendv_ps(clear.0, set.0, self.0) })
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }

        #[inline(always)]
        fn larger(self, other: Self) -> Self {
            // SAFETY: this CPU has AVX, see the type.
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
        }

        #[inline(always)]
        fn sum(self) -> f64 {
            // SAFETY: this CPU has AVX, see the type.
            let four = unsafe {
                _mm_add_ps(
                    _mm256_castps256_ps128(self.0),
                    _mm256_extractf128_ps::<1>(self.0),
                )
            };
            f64::from(sum_of_four(four))
        }

        #[inline(always)]
        fn at_least(self, other: Self) -> u8 {
            // SAFETY: this CPU has AVX, see the type.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0)) as u8 }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::SimdLevel;
    use super::*;

    /// Every operation once.
    struct Everything<'a>(&'a [f32]);

    impl EightKernel for Everything<'_> {
        type Output = ([f32; EIGHT], u8, f64);

        #[inline(always)]
        fn run<L: Eight>(self) -> Self::Output {
            let (a, b) = (L::load(self.0, 0), L::load(self.0, 5));
            let mut c = (a + b) * a - b;
            c += L::splat(0.5);
            let kept = c.keep(L::first(6));
            let root = (kept * kept).sqrt();
            let mut out = [0.0; EIGHT];
            let root = a.mask_from(b).choose(root, kept);
            root.store(&mut out, 0);
            (
                out,
                a.at_least(b),
                (root + L::unpack(&Packed::STEPS) + L::zero()).sum(),
            )
        }
    }

    #[test]
    fn every_level_computes_what_plain_arrays_do() {
        let mut data: Vec<f32> = (0..13u8).map(|i| (f32::from(i) * 1.7).sin()).collect();
        for nan in [false, true] {
            if nan {
                data[7] = f32::NAN;
            }
            let want = Everything(&data).run::<Plain>();
            for level in SimdLevel::available() {
                let got = dispatch_eight(level, Everything(&data));
                assert_eq!(
                    got.0.map(f32::to_bits),
                    want.0.map(f32::to_bits),
                    "{level:?}"
                );
                assert_eq!(
                    (got.1, got.2.to_bits()),
                    (want.1, want.2.to_bits()),
                    "{level:?}"
                );
            }
        }
    }
}
