//! Every vehicle with its measures, mass, engine and paints.

use schema_types::Class;
use simd_body::BodyStyle;

use super::engines::*;
use super::model::VehicleModel;

const PAINTS: &[[u8; 3]] = &[
    [156, 28, 30],
    [22, 58, 112],
    [222, 224, 226],
    [24, 25, 28],
    [120, 124, 128],
    [172, 176, 180],
    [40, 88, 70],
    [196, 132, 28],
    [88, 52, 36],
    [66, 104, 150],
];
const TRUCK_PAINTS: &[[u8; 3]] = &[
    [214, 216, 218],
    [26, 76, 140],
    [186, 36, 30],
    [224, 168, 24],
    [52, 96, 60],
];
const BUS_PAINTS: &[[u8; 3]] = &[
    [206, 44, 36],
    [238, 196, 40],
    [34, 110, 168],
    [230, 232, 232],
];
const FIRE_PAINTS: &[[u8; 3]] = &[[196, 22, 20]];
const STEEL_PAINTS: &[[u8; 3]] = &[[150, 152, 156]];
const POLICE_PAINTS: &[[u8; 3]] = &[[20, 20, 24]];
const TAXI_PAINTS: &[[u8; 3]] = &[[238, 190, 20]];
const AMBULANCE_PAINTS: &[[u8; 3]] = &[[240, 240, 236]];

/// Fields shared by vehicles of one kind; the table below overrides them.
const CAR: VehicleModel = VehicleModel {
    type_id: "",
    style: BodyStyle::Saloon,
    class: Class::CAR,
    base_type: "car",
    special_type: "",
    generation: 1,
    half_m: [2.3, 0.95, 0.74],
    n_axles: 2,
    wheelbase_m: 2.7,
    wheel_radius_m: 0.33,
    mass_kg: 1500.0,
    drag_area_m2: 0.65,
    engine: PETROL_STRONG,
    front_driven: false,
    rear_driven: true,
    colors: PAINTS,
};
const HATCH: VehicleModel = VehicleModel {
    style: BodyStyle::Hatch,
    engine: PETROL_SMALL,
    front_driven: true,
    rear_driven: false,
    mass_kg: 1180.0,
    wheelbase_m: 2.45,
    wheel_radius_m: 0.31,
    ..CAR
};
const SUV: VehicleModel = VehicleModel {
    style: BodyStyle::Suv,
    engine: PETROL_LARGE,
    front_driven: true,
    mass_kg: 2100.0,
    wheelbase_m: 2.8,
    wheel_radius_m: 0.38,
    drag_area_m2: 0.95,
    ..CAR
};
const VAN: VehicleModel = VehicleModel {
    style: BodyStyle::Van,
    base_type: "van",
    engine: DIESEL_VAN,
    mass_kg: 2400.0,
    wheelbase_m: 3.4,
    wheel_radius_m: 0.35,
    drag_area_m2: 1.6,
    ..CAR
};
const LORRY: VehicleModel = VehicleModel {
    style: BodyStyle::Lorry,
    class: Class::TRUCK,
    base_type: "truck",
    engine: DIESEL_HEAVY,
    mass_kg: 9000.0,
    wheelbase_m: 4.6,
    wheel_radius_m: 0.50,
    drag_area_m2: 5.0,
    colors: TRUCK_PAINTS,
    ..CAR
};
const MOTORCYCLE: VehicleModel = VehicleModel {
    style: BodyStyle::Motorcycle,
    class: Class::MOTORCYCLE,
    base_type: "motorcycle",
    engine: MOTORBIKE,
    mass_kg: 270.0,
    wheelbase_m: 1.42,
    wheel_radius_m: 0.31,
    drag_area_m2: 0.55,
    ..CAR
};
const BICYCLE: VehicleModel = VehicleModel {
    style: BodyStyle::Bicycle,
    class: Class::BICYCLE,
    base_type: "bicycle",
    engine: LEGS,
    mass_kg: 90.0,
    wheelbase_m: 1.0,
    wheel_radius_m: 0.34,
    drag_area_m2: 0.6,
    ..CAR
};

pub static MODELS: &[VehicleModel] = &[
    VehicleModel {
        type_id: "vehicle.tesla.model3",
        special_type: "electric",
        half_m: [2.396, 1.082, 0.744],
        wheelbase_m: 2.875,
        wheel_radius_m: 0.34,
        mass_kg: 1847.0,
        drag_area_m2: 0.52,
        engine: ELECTRIC,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.lincoln.mkz_2020",
        generation: 2,
        half_m: [2.446, 1.115, 0.740],
        wheelbase_m: 2.85,
        mass_kg: 1700.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.lincoln.mkz_2017",
        half_m: [2.451, 1.064, 0.755],
        wheelbase_m: 2.85,
        mass_kg: 1700.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.dodge.charger_2020",
        generation: 2,
        half_m: [2.503, 1.049, 0.767],
        wheelbase_m: 3.05,
        wheel_radius_m: 0.35,
        mass_kg: 1920.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.dodge.charger_police",
        special_type: "emergency",
        half_m: [2.487, 1.019, 0.771],
        wheelbase_m: 3.05,
        mass_kg: 1950.0,
        colors: POLICE_PAINTS,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.ford.crown",
        special_type: "taxi",
        generation: 2,
        half_m: [2.683, 0.901, 0.787],
        wheelbase_m: 2.91,
        mass_kg: 1850.0,
        colors: TAXI_PAINTS,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.ford.mustang",
        half_m: [2.359, 0.947, 0.650],
        wheelbase_m: 2.72,
        mass_kg: 1650.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.chevrolet.impala",
        half_m: [2.679, 1.017, 0.705],
        wheelbase_m: 2.84,
        mass_kg: 1680.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.mercedes.coupe",
        half_m: [2.513, 1.076, 0.825],
        wheelbase_m: 2.94,
        mass_kg: 1900.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.mercedes.coupe_2020",
        generation: 2,
        half_m: [2.337, 1.001, 0.721],
        wheelbase_m: 2.84,
        mass_kg: 1700.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.bmw.grandtourer",
        half_m: [2.306, 1.121, 0.834],
        wheelbase_m: 2.78,
        mass_kg: 1600.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.audi.tt",
        half_m: [2.091, 0.997, 0.693],
        wheelbase_m: 2.5,
        mass_kg: 1400.0,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.audi.a2",
        half_m: [1.853, 0.894, 0.775],
        wheelbase_m: 2.4,
        mass_kg: 1050.0,
        ..HATCH
    },
    VehicleModel {
        type_id: "vehicle.citroen.c3",
        half_m: [1.994, 0.925, 0.809],
        wheelbase_m: 2.46,
        ..HATCH
    },
    VehicleModel {
        type_id: "vehicle.mini.cooper_s",
        half_m: [1.903, 0.985, 0.738],
        wheelbase_m: 2.47,
        ..HATCH
    },
    VehicleModel {
        type_id: "vehicle.nissan.micra",
        half_m: [1.817, 0.923, 0.751],
        wheelbase_m: 2.45,
        mass_kg: 1000.0,
        ..HATCH
    },
    VehicleModel {
        type_id: "vehicle.seat.leon",
        half_m: [2.096, 0.908, 0.737],
        wheelbase_m: 2.6,
        mass_kg: 1300.0,
        ..HATCH
    },
    VehicleModel {
        type_id: "vehicle.toyota.prius",
        special_type: "electric",
        half_m: [2.257, 1.003, 0.762],
        wheelbase_m: 2.7,
        mass_kg: 1400.0,
        ..HATCH
    },
    VehicleModel {
        type_id: "vehicle.micro.microlino",
        special_type: "electric",
        half_m: [1.104, 0.740, 0.688],
        wheelbase_m: 1.5,
        wheel_radius_m: 0.26,
        mass_kg: 560.0,
        engine: ELECTRIC_SMALL,
        ..HATCH
    },
    VehicleModel {
        type_id: "vehicle.audi.etron",
        special_type: "electric",
        half_m: [2.428, 1.016, 0.825],
        wheelbase_m: 2.93,
        mass_kg: 2400.0,
        engine: ELECTRIC,
        ..SUV
    },
    VehicleModel {
        type_id: "vehicle.nissan.patrol",
        half_m: [2.302, 0.966, 0.927],
        wheelbase_m: 2.75,
        mass_kg: 2200.0,
        ..SUV
    },
    VehicleModel {
        type_id: "vehicle.nissan.patrol_2021",
        generation: 2,
        half_m: [2.783, 1.075, 1.023],
        wheelbase_m: 3.08,
        wheel_radius_m: 0.40,
        mass_kg: 2700.0,
        ..SUV
    },
    VehicleModel {
        type_id: "vehicle.jeep.wrangler_rubicon",
        half_m: [1.933, 0.953, 0.939],
        wheelbase_m: 2.42,
        wheel_radius_m: 0.40,
        mass_kg: 1850.0,
        ..SUV
    },
    VehicleModel {
        type_id: "vehicle.mercedes.sprinter",
        generation: 2,
        half_m: [2.958, 0.994, 1.280],
        wheelbase_m: 3.66,
        ..VAN
    },
    VehicleModel {
        type_id: "vehicle.volkswagen.t2",
        style: BodyStyle::Microbus,
        half_m: [2.240, 1.035, 1.019],
        wheelbase_m: 2.4,
        mass_kg: 1500.0,
        engine: PETROL_SMALL,
        ..VAN
    },
    VehicleModel {
        type_id: "vehicle.ford.ambulance",
        special_type: "emergency",
        generation: 2,
        half_m: [3.183, 1.176, 1.216],
        wheelbase_m: 3.9,
        mass_kg: 3800.0,
        colors: AMBULANCE_PAINTS,
        ..VAN
    },
    VehicleModel {
        type_id: "vehicle.carlamotors.carlacola",
        half_m: [2.602, 1.313, 1.234],
        wheelbase_m: 3.0,
        wheel_radius_m: 0.42,
        mass_kg: 5500.0,
        ..LORRY
    },
    VehicleModel {
        type_id: "vehicle.carlamotors.european_hgv",
        generation: 2,
        half_m: [3.962, 1.432, 1.892],
        n_axles: 3,
        wheelbase_m: 4.6,
        ..LORRY
    },
    VehicleModel {
        type_id: "vehicle.carlamotors.firetruck",
        special_type: "emergency",
        generation: 2,
        half_m: [4.234, 1.446, 1.914],
        wheelbase_m: 4.9,
        mass_kg: 12000.0,
        colors: FIRE_PAINTS,
        ..LORRY
    },
    VehicleModel {
        type_id: "vehicle.mitsubishi.fusorosa",
        style: BodyStyle::Bus,
        class: Class::BUS,
        base_type: "bus",
        generation: 2,
        half_m: [5.1, 1.97, 2.12],
        wheelbase_m: 5.4,
        mass_kg: 8500.0,
        colors: BUS_PAINTS,
        ..LORRY
    },
    VehicleModel {
        type_id: "vehicle.harley-davidson.low_rider",
        half_m: [1.178, 0.382, 0.638],
        wheelbase_m: 1.62,
        mass_kg: 370.0,
        ..MOTORCYCLE
    },
    VehicleModel {
        type_id: "vehicle.kawasaki.ninja",
        half_m: [1.017, 0.401, 0.600],
        ..MOTORCYCLE
    },
    VehicleModel {
        type_id: "vehicle.yamaha.yzf",
        half_m: [1.105, 0.434, 0.626],
        ..MOTORCYCLE
    },
    VehicleModel {
        type_id: "vehicle.bh.crossbike",
        half_m: [0.744, 0.430, 0.638],
        wheelbase_m: 0.86,
        wheel_radius_m: 0.31,
        ..BICYCLE
    },
    VehicleModel {
        type_id: "vehicle.diamondback.century",
        half_m: [0.821, 0.186, 0.748],
        wheelbase_m: 0.97,
        wheel_radius_m: 0.335,
        ..BICYCLE
    },
    VehicleModel {
        type_id: "vehicle.gazelle.omafiets",
        half_m: [0.918, 0.16, 0.586],
        ..BICYCLE
    },
    VehicleModel {
        type_id: "vehicle.dodge.charger_police_2020",
        special_type: "emergency",
        generation: 2,
        half_m: [2.619, 1.049, 0.819],
        wheelbase_m: 3.05,
        mass_kg: 2050.0,
        engine: PETROL_LARGE,
        colors: POLICE_PAINTS,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.mini.cooper_s_2021",
        generation: 2,
        half_m: [2.276, 1.049, 0.884],
        wheelbase_m: 2.67,
        mass_kg: 1390.0,
        engine: PETROL_STRONG,
        ..HATCH
    },
    VehicleModel {
        type_id: "vehicle.tesla.cybertruck",
        style: BodyStyle::Wedge,
        class: Class::TRUCK,
        base_type: "truck",
        special_type: "electric",
        generation: 2,
        half_m: [3.137, 1.195, 1.049],
        wheelbase_m: 3.81,
        wheel_radius_m: 0.44,
        mass_kg: 3000.0,
        drag_area_m2: 1.1,
        engine: ELECTRIC,
        front_driven: true,
        colors: STEEL_PAINTS,
        ..CAR
    },
    VehicleModel {
        type_id: "vehicle.volkswagen.t2_2021",
        style: BodyStyle::Microbus,
        generation: 2,
        half_m: [2.221, 0.939, 0.994],
        wheelbase_m: 2.4,
        wheel_radius_m: 0.33,
        mass_kg: 1600.0,
        engine: PETROL_SMALL,
        ..VAN
    },
    VehicleModel {
        type_id: "vehicle.vespa.zx125",
        half_m: [0.902, 0.36, 0.618],
        wheelbase_m: 1.26,
        wheel_radius_m: 0.24,
        mass_kg: 185.0,
        engine: SCOOTER,
        ..MOTORCYCLE
    },
];

/// Every vehicle; the index is also its place in the catalogue.
pub fn vehicle_models() -> &'static [VehicleModel] {
    MODELS
}

/// A vehicle's kind in a checkpoint: its catalogue id.
pub(crate) mod by_type_id {
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    use super::{VehicleModel, vehicle_models};

    pub(crate) fn serialize<S: Serializer>(
        model: &&'static VehicleModel,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        model.type_id.serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<&'static VehicleModel, D::Error> {
        let type_id = String::deserialize(deserializer)?;
        let found = vehicle_models()
            .iter()
            .find(|model| model.type_id == type_id);
        found.ok_or_else(|| serde::de::Error::custom(format!("there is no vehicle {type_id:?}")))
    }
}
