//! Tests of `sensor_ray`: one program for all of them, so that it is linked once.

mod bundles;
mod camera;
mod carla_lidar;
mod common;
mod gpu_lidar;
mod lidar;
mod radar;
mod rays;
mod time_of_ray;
