//! Matrix products: rows of the first operand, columns of the second.

use super::elementwise::{broadcast, common};
use super::{Asked, Division, Piece, Region, Source};

pub(super) fn divide(asked: Asked<'_>) -> Option<Division<'_>> {
    match asked.operator() {
        "MatMul" => matmul(asked),
        "Gemm" => gemm(asked),
        _ => None,
    }
}

/// a \[…,M,K\] · b \[…,K,N\] → \[…,M,N\].
fn matmul(asked: Asked<'_>) -> Option<Division<'_>> {
    let (a, b) = (asked.shape(0)?, asked.shape(1)?);
    let (ra, rb) = (a.len().checked_sub(2)?, b.len().checked_sub(2)?);
    if a[ra + 1] != b[rb] {
        return None;
    }
    let batch = common(&[&a[..ra], &b[..rb]])?;
    let shape: Vec<usize> = batch.iter().copied().chain([a[ra], b[rb + 1]]).collect();
    let cut = move |region: &Region| {
        let (batch, [rows, columns]) = region.0.split_last_chunk::<2>()?;
        let batch = Region(batch.to_vec());
        let of = |lead: &[usize], last: [&std::ops::Range<usize>; 2]| {
            let mut own = broadcast(&batch, lead)?;
            own.0.extend(last.map(Clone::clone));
            Some(Source::Part(own))
        };
        let inner = 0..a[ra + 1];
        let operands = vec![of(&a[..ra], [rows, &inner])?, of(&b[..rb], [&inner, columns])?];
        Some(Piece { node: asked.node(), operands })
    };
    let rank = shape.len();
    let cost = 8.0 + a[ra + 1] as f64;
    Some(Division {
        shape,
        axes: vec![true; rank],
        cost,
        run: Some(rank - 1),
        block: None,
        cut: Box::new(cut),
    })
}

/// α·A·B + β·C with A \[M,K\] or, transposed, \[K,M\]; B likewise; C broadcast to \[M,N\].
fn gemm(asked: Asked<'_>) -> Option<Division<'_>> {
    let (a, b) = (asked.shape(0)?, asked.shape(1)?);
    let (&[a0, a1], &[b0, b1]) = (a, b) else { return None };
    let (trans_a, trans_b) = (asked.int("transA", 0) == 1, asked.int("transB", 0) == 1);
    let (m, k) = if trans_a { (a1, a0) } else { (a0, a1) };
    let (inner, n) = if trans_b { (b1, b0) } else { (b0, b1) };
    if inner != k {
        return None;
    }
    let cut = move |region: &Region| {
        let [rows, columns] = &region.0[..] else { return None };
        let pair = |swap: bool, first: &std::ops::Range<usize>, second: &std::ops::Range<usize>| {
            let pair = if swap { [second, first] } else { [first, second] };
            Source::Part(Region(pair.map(Clone::clone).to_vec()))
        };
        let mut operands = asked.operands();
        operands[0] = pair(trans_a, rows, &(0..k));
        operands[1] = pair(trans_b, &(0..k), columns);
        if let Some(c) = asked.shape(2) {
            operands[2] = Source::Part(broadcast(region, c)?);
        }
        Some(Piece { node: asked.node(), operands })
    };
    let cost = 8.0 + k as f64;
    Some(Division {
        shape: vec![m, n],
        axes: vec![true; 2],
        cost,
        run: Some(1),
        block: None,
        cut: Box::new(cut),
    })
}
