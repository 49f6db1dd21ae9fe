//! Answers every frame of a camera with a tensor that stays on the GPU: `features [TOPIC] [DOMAIN]`.
//! The tensor is the frame's own pixels; a network would write its output there.

use std::time::Duration;

use consumer_gpu::{Body, Device, GpuPublisher, GpuTopic};
use schema_bus::{GpuPlaces, ResultTopic};
use schema_frames::{ElementType, ResultType};

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let topic = arguments.next().unwrap_or("ego/front/rgb".into());
    let domain = arguments.next().unwrap_or("gantry".into());
    let bus = schema_bus::Bus::open(&domain, "features")?;
    let mut camera = GpuTopic::open(&bus, &topic, Device::Cuda)?;
    let spec = ResultTopic::new(ResultType::Tensor);
    let places = GpuPlaces::default();
    let features = GpuPublisher::open(&bus, "features", &spec, places, 0, Device::Cuda)?;
    while let Some(frame) = camera.wait(&bus, Duration::from_secs(10))? {
        let mut draft = features.draft();
        draft.answers(&frame);
        let shape = [frame.header().height, frame.header().width, 4];
        draft.header_mut().set_tensor(ElementType::U8, &shape)?;
        #[expect(unsafe_code, reason = "an address of the device")]
        // SAFETY: the frame is on the device, four bytes a pixel as its topic says, it was complete
        // before it was sent, and it is held until the copy is done.
        let n_readers = unsafe { features.send(draft, Body::Device(frame.address()))? };
        println!("tick {}: {n_readers} readers", frame.header().tick);
    }
    Ok(())
}
