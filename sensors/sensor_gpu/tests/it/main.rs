//! Tests of `sensor_gpu`: one program for all of them, so that it is linked once.

mod beside;
mod copies;
mod device_memory;
mod other_device;
