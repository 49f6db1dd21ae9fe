//! Files that clients download: the navigation mesh for their own crowds.

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::state::navigation_file::NavigationFile;
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};

pub(crate) const CALLS: Calls = &[
    ("get_required_files", required_files),
    ("request_file", request_file),
    ("get_navigation_mesh", navigation_mesh),
];

fn navigation_file(gateway: &Gateway) -> Result<NavigationFile, Failure> {
    let name = gateway.info()?.map;
    let map = gateway.world.known().map.clone();
    Ok(gateway.navigation.of(map, &name))
}

fn required_files(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let folder = call.text()?;
    if !matches!(folder.trim_matches('/'), "" | "Nav") {
        return Ok(Answer::Value(list![]));
    }
    Ok(Answer::Value(Value::Array(
        navigation_file(gateway)?
            .name
            .into_iter()
            .map(Value::from)
            .collect(),
    )))
}

fn request_file(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let name = call.text()?;
    let navigation = navigation_file(gateway)?;
    if navigation.name.as_deref() != Some(name) {
        return Err(Failure::Refused(format!(
            "there is no file {name:?}; get_required_files lists those of the running map"
        )));
    }
    Ok(Answer::Value(Value::Bin(navigation.bytes.to_vec())))
}

fn navigation_mesh(gateway: &Gateway, _: &mut Call<'_>) -> Outcome {
    Ok(Answer::Value(Value::Bin(
        navigation_file(gateway)?.bytes.to_vec(),
    )))
}
