//! One call: its arguments, which are read in order, and the connection that it came over.

use std::ops::{Deref, DerefMut};

use consumer_rpc::budget::Account;

use crate::gateway::Gateway;
use crate::wire::fields::Fields;
use crate::wire::requests::{Failure, Outcome, Request};

/// The function that serves a method.
pub(crate) type Run = fn(&Gateway, &mut Call<'_>) -> Outcome;

/// The calls of one area.
pub(crate) type Calls = &'static [(&'static str, Run)];

/// One call: its arguments, which are read in order, and the connection that it came over.
#[derive(Debug)]
pub(crate) struct Call<'v> {
    args: Fields<'v>,
    /// The method's name.
    pub method: &'v str,
    /// Number of the client's connection.
    pub connection: u64,
    /// What the connection owns.
    pub account: &'v Account,
}

impl<'v> Deref for Call<'v> {
    type Target = Fields<'v>;
    fn deref(&self) -> &Fields<'v> {
        &self.args
    }
}

impl<'v> DerefMut for Call<'v> {
    fn deref_mut(&mut self) -> &mut Fields<'v> {
        &mut self.args
    }
}

impl<'v> Call<'v> {
    /// A request that came over the connection of `account`.
    pub fn new(request: &'v Request, account: &'v Account) -> Self {
        Call {
            args: Fields::new("the arguments", &request.args),
            method: &request.method,
            connection: account.number(),
            account,
        }
    }

    /// Reads the id of an actor and checks that it exists.
    pub fn known_actor(&mut self, gateway: &Gateway) -> Result<u32, Failure> {
        let id = self.u32()?;
        if gateway.world.known().has_actor(id) {
            return Ok(id);
        }
        Err(Failure::Refused(format!(
            "actor {id} could not be found; it does not exist or was destroyed"
        )))
    }
}
