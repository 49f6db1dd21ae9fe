//! What stands beside the roads: lamps, street furniture, parked cars, traffic lights and signs.

mod kerbside;
mod parked_cars;
mod signals;

pub use kerbside::roadside;
pub use parked_cars::parked;
pub use signals::signal;
