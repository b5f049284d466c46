//! Covariances of phase gradients that are averaged over squares.
//!
//! For squares of areas A_i, A_l whose centres are s apart, and the intercorrelation I of the two
//! (the area over which they overlap when one is shifted by u; a product of two trapezia T),
//!
//! <g_i,a g_l,b> = 1 / (2 A_i A_l) int int d^2 D / (da db) (u) T(u_x - s_x) T(u_y - s_y) d^2u.
//!
//! Integrated by parts, the derivatives go to the trapezia, whose second derivative is four delta
//! functions: c = +1, -1, -1, +1 at u = s -+ (a + b) / 2, -+ (a - b) / 2 for sides a and b. What is
//! left needs no quadrature:
//!
//! <g_x g_x> = 1 / (2 A_i A_l) sum_k sum_l c_k c_l P(u_k, v_l),  d^2 P / dy^2 = D
//! <g_x g_y> = 1 / (2 A_i A_l) sum_k sum_l c_k c_l Q(u_k, v_l),  d^2 Q / (dx dy) = D
//!
//! and <g_y g_y> is <g_x g_x> with the axes exchanged. Terms of P that are linear in y drop out, and
//! Q is homogeneous of degree 11/3, so Euler's theorem gives it from its own derivatives: with K of
//! [`super::kolmogorov`] and D = C r^(5/3),
//!
//! P = C [y K(x, y) - (3/11) r^(11/3)],  Q = (3/11) C [x K(x, y) + y K(y, x)].
//!
//! Nothing is singular: squares that touch or coincide are as good as any. The error is that of
//! sixteen terms of about r^(11/3) which nearly cancel. In units of the gradients' variance it is at
//! most 1e-9 for beta >= 0.75, 6e-9 for 0.5 and 4e-6 for 0.1 at N = 40; 2e-11, 2e-10 and 4e-8 at 16.

use super::kolmogorov::{LineIntegral, structure};
use super::squares::Squares;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// The covariances of the gradients over two squares, in rad^2 per squared pupil radius for
/// D / r0 = 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance {
    /// Of the x gradients.
    pub xx: f64,
    /// Of one's x gradient and the other's y gradient: it does not matter whose.
    pub xy: f64,
    /// Of the y gradients.
    pub yy: f64,
}

/// Two squares at any distance.
#[derive(Clone, Debug)]
pub struct SquarePair {
    /// Where the second derivative of the trapezium lies, with its sign.
    corners: [(f64, f64); 4],
    /// C / (2 A_i A_l).
    scale: f64,
    integral: LineIntegral,
}

impl SquarePair {
    /// Squares of sides `a` and `b`, above 0.
    pub fn new(a: f64, b: f64) -> Self {
        let (outer, inner) = (0.5 * (a + b), 0.5 * (a - b));
        Self {
            corners: [(-outer, 1.0), (-inner, -1.0), (inner, -1.0), (outer, 1.0)],
            scale: structure() / (2.0 * (a * b).powi(2)),
            integral: LineIntegral::new(),
        }
    }

    /// Their covariances with their centres `separation` apart.
    pub fn covariance(&self, separation: [f64; 2]) -> Covariance {
        let mut sum = Covariance { xx: 0.0, xy: 0.0, yy: 0.0 };
        for (du, cu) in self.corners {
            for (dv, cv) in self.corners {
                let (x, y) = (separation[0] + du, separation[1] + dv);
                let (along_y, r53) = self.integral.at(x, y);
                let (along_x, _) = self.integral.at(y, x);
                let r113 = 3.0 / 11.0 * r53 * (x * x + y * y);
                let sign = cu * cv;
                sum.xx += sign * (y * along_y - r113);
                sum.xy += sign * 3.0 / 11.0 * (x * along_y + y * along_x);
                sum.yy += sign * (x * along_x - r113);
            }
        }
        Covariance { xx: self.scale * sum.xx, xy: self.scale * sum.xy, yy: self.scale * sum.yy }
    }
}

/// The covariances of all gradients over `rows` with all over `columns`, which are as many: x and
/// y gradient of the first square, of the second, and so on.
///
/// # Panics
/// If the squares are not of the same pupil.
pub fn matrix(rows: &Squares, columns: &Squares) -> DMatrix<f64> {
    assert_eq!(rows.cells(), columns.cells(), "squares of one pupil");
    let pair = SquarePair::new(rows.side(), columns.side());
    let lattice = Lattice::new(rows, columns, &pair);
    let count = 2 * rows.count();
    let mut matrix = DMatrix::zeros(count, count);
    let of_one_square = matrix.as_mut_slice().par_chunks_exact_mut(2 * count);
    of_one_square.enumerate().for_each(|(l, columns_of_l)| {
        let (with_x, with_y) = columns_of_l.split_at_mut(count);
        for i in 0..rows.count() {
            let covariance = match &lattice {
                Some(lattice) => lattice.covariance(rows.cells()[i], columns.cells()[l]),
                None => {
                    let (from, to) = (rows.centre(i), columns.centre(l));
                    pair.covariance([from[0] - to[0], from[1] - to[1]])
                }
            };
            with_x[2 * i..2 * i + 2].copy_from_slice(&[covariance.xx, covariance.xy]);
            with_y[2 * i..2 * i + 2].copy_from_slice(&[covariance.xy, covariance.yy]);
        }
    });
    matrix
}

/// Where both sets of squares have the same pitch, separations are whole pitches: each covariance
/// is computed once.
struct Lattice {
    across: usize,
    /// For separations of 0, 1 ... pitches in x, then in y.
    table: Vec<Covariance>,
}

impl Lattice {
    fn new(rows: &Squares, columns: &Squares, pair: &SquarePair) -> Option<Self> {
        let pitch = rows.pitch();
        if pitch != columns.pitch() {
            return None;
        }
        let farthest = rows.cells().iter().flatten().map(|cell| cell.unsigned_abs()).max()?;
        let across = farthest as usize + 1;
        let at = |k: usize| [(k % across) as f64 * pitch, (k / across) as f64 * pitch];
        let table = (0..across * across).into_par_iter().map(|k| pair.covariance(at(k))).collect();
        Some(Self { across, table })
    }

    /// Reflection in an axis changes the sign of xy only.
    fn covariance(&self, from: [i32; 2], to: [i32; 2]) -> Covariance {
        let [x, y] = [(from[0] - to[0]) / 2, (from[1] - to[1]) / 2];
        let found =
            self.table[(y.unsigned_abs() as usize) * self.across + x.unsigned_abs() as usize];
        Covariance { xy: found.xy * f64::from(x.signum() * y.signum()), ..found }
    }
}
