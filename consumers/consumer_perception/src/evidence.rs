//! The evidence of a score: the truth of a moment ([`moment`]), the results that a program had given
//! by then ([`queries`]), which truths count ([`ignore`]), and what of it is kept for others'
//! scorers ([`coco_keep`]).

pub mod coco_keep;
pub mod ignore;
pub mod moment;
pub mod queries;
