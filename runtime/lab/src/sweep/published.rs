//! Sequences of public data sets, where they are to be had, and what others have published on them.

/// Knowledge that the poses of a published trajectory rest on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Knowledge {
    /// Each pose as known when its frame came.
    Causal,
    /// Each pose as known at the end.
    Final,
    /// The publication does not say.
    NotStated,
}

/// A published mean error over the sequences of a suite.
#[derive(Clone, Copy, Debug)]
pub struct PublishedFigure {
    /// The system, with its sensors.
    pub system: &'static str,
    /// Mean ATE, m.
    pub ate_m: f64,
    /// Knowledge that the poses of the trajectory rest on.
    pub knowledge: Knowledge,
    /// Alignment and what else differs.
    pub conditions: &'static str,
    /// Publication that gives the figure.
    pub source: &'static str,
}

/// A sequence of a public data set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sequence {
    /// Name of its folder.
    pub name: &'static str,
    /// Length, s, where it is known: a data set of that name that is much shorter is a part of it.
    pub length_s: Option<f64>,
}

const fn sequence(name: &'static str, length_s: f64) -> Sequence {
    Sequence { name, length_s: Some(length_s) }
}

const fn of_any_length(name: &'static str) -> Sequence {
    Sequence { name, length_s: None }
}

/// A public data set.
#[derive(Debug)]
pub struct Suite {
    /// Name of the data set.
    pub name: &'static str,
    /// Its sequences.
    pub sequences: &'static [Sequence],
    /// Address of the download.
    pub available_at: &'static str,
    /// Sequences that the published figures are means of.
    pub mean_of: &'static str,
    /// Figures that others have published.
    pub published: &'static [PublishedFigure],
}

impl Suite {
    /// The sequence of this name, and its place.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<(usize, &'static Sequence)> {
        self.sequences.iter().enumerate().find(|(_, sequence)| sequence.name == name)
    }

    /// The suite that has a sequence called `name`.
    #[must_use]
    pub fn of(name: &str) -> Option<&'static Self> {
        SUITES.iter().find(|suite| suite.find(name).is_some())
    }
}

const OKVIS2X: &str = "Boche et al., T-RO 2025, DOI 10.1109/TRO.2025.3619051, arXiv:2510.04612";
const OKVIS2: &str = "Leutenegger, \"OKVIS2: Realtime Scalable Visual-Inertial SLAM with Loop Closure\", 2022, arXiv:2202.09199";
const ORB_SLAM3: &str =
    "Campos et al., T-RO 2021, DOI 10.1109/TRO.2021.3075644, arXiv:2007.11898, Table II and abstract";
const DM_VIO: &str = "von Stumberg and Cremers, RA-L 2022, arXiv:2201.04114, Tables I and II";
const CUVSLAM: &str = "Korovko et al. 2025, arXiv:2506.04359v3, Table 2";

/// A figure over the eleven sequences of EuRoC.
const fn figure(
    system: &'static str,
    ate_m: f64,
    knowledge: Knowledge,
    conditions: &'static str,
    source: &'static str,
) -> PublishedFigure {
    PublishedFigure { system, ate_m, knowledge, conditions, source }
}

/// The suites that the table knows.
pub const SUITES: [Suite; 2] = [
    Suite {
        name: "EuRoC",
        sequences: &[
            sequence("MH_01_easy", 181.9),
            sequence("MH_02_easy", 150.0),
            sequence("MH_03_medium", 131.5),
            sequence("MH_04_difficult", 98.8),
            sequence("MH_05_difficult", 111.1),
            sequence("V1_01_easy", 144.7),
            sequence("V1_02_medium", 83.5),
            sequence("V1_03_difficult", 104.7),
            sequence("V2_01_easy", 112.0),
            sequence("V2_02_medium", 115.4),
            sequence("V2_03_difficult", 114.8),
        ],
        available_at: "ETH Research Collection, DOI 10.3929/ethz-b-000690084 (Burri et al., IJRR 2016)",
        mean_of: "all eleven sequences",
        published: &[
            figure(
                "OKVIS2-X, stereo, without loops",
                0.050,
                Knowledge::Causal,
                "4-DoF; as quoted by others",
                OKVIS2X,
            ),
            figure(
                "OKVIS2-X, stereo",
                0.023,
                Knowledge::Final,
                "4-DoF, with loops; as quoted by others",
                OKVIS2X,
            ),
            figure("OKVIS2, stereo", 0.071, Knowledge::Causal, "4-DoF; as quoted by others", OKVIS2),
            figure(
                "OKVIS2, stereo",
                0.031,
                Knowledge::Final,
                "4-DoF, with loops; as quoted by others",
                OKVIS2,
            ),
            figure(
                "OpenVINS, stereo",
                0.183,
                Knowledge::Causal,
                "4-DoF, flown again there; as quoted by others",
                OKVIS2X,
            ),
            figure("ORB-SLAM3, stereo", 0.035, Knowledge::Final, "SE(3), with loops", ORB_SLAM3),
            figure(
                "VINS-Fusion, stereo",
                0.138,
                Knowledge::NotStated,
                "figure of its authors, given there",
                ORB_SLAM3,
            ),
            figure(
                "Basalt, stereo",
                0.072,
                Knowledge::NotStated,
                "without loops, without V2_03; given there",
                DM_VIO,
            ),
            figure(
                "DM-VIO, one camera",
                0.069,
                Knowledge::NotStated,
                "SE(3), without loops, median of ten",
                DM_VIO,
            ),
            figure(
                "cuVSLAM, stereo without IMU",
                0.054,
                Knowledge::Final,
                "Sim(3), with loops, without V2_03; needs a GPU",
                CUVSLAM,
            ),
            figure(
                "cuVSLAM, stereo with IMU",
                0.13,
                Knowledge::Final,
                "Sim(3), with loops; needs a GPU",
                CUVSLAM,
            ),
            figure(
                "cuVSLAM, stereo with IMU",
                0.19,
                Knowledge::NotStated,
                "Sim(3), without loops; needs a GPU",
                CUVSLAM,
            ),
        ],
    },
    Suite {
        name: "TUM-VI",
        sequences: &[
            of_any_length("dataset-corridor1_512_16"),
            of_any_length("dataset-corridor2_512_16"),
            of_any_length("dataset-corridor3_512_16"),
            of_any_length("dataset-corridor4_512_16"),
            of_any_length("dataset-corridor5_512_16"),
            of_any_length("dataset-magistrale1_512_16"),
            of_any_length("dataset-magistrale2_512_16"),
            of_any_length("dataset-magistrale3_512_16"),
            of_any_length("dataset-magistrale4_512_16"),
            of_any_length("dataset-magistrale5_512_16"),
            of_any_length("dataset-magistrale6_512_16"),
            of_any_length("dataset-outdoors1_512_16"),
            of_any_length("dataset-outdoors2_512_16"),
            of_any_length("dataset-outdoors3_512_16"),
            of_any_length("dataset-outdoors4_512_16"),
            of_any_length("dataset-outdoors5_512_16"),
            of_any_length("dataset-outdoors6_512_16"),
            of_any_length("dataset-outdoors7_512_16"),
            of_any_length("dataset-outdoors8_512_16"),
            of_any_length("dataset-room1_512_16"),
            of_any_length("dataset-room2_512_16"),
            of_any_length("dataset-room3_512_16"),
            of_any_length("dataset-room4_512_16"),
            of_any_length("dataset-room5_512_16"),
            of_any_length("dataset-room6_512_16"),
            of_any_length("dataset-slides1_512_16"),
            of_any_length("dataset-slides2_512_16"),
            of_any_length("dataset-slides3_512_16"),
        ],
        available_at: "Technical University of Munich, \"Visual-Inertial Dataset\" (Schubert et al., IROS 2018, \
                       DOI 10.1109/IROS.2018.8593419, arXiv:1804.06120)",
        mean_of: "the six rooms",
        published: &[
            figure("ORB-SLAM3, stereo", 0.009, Knowledge::Final, "SE(3), with loops", ORB_SLAM3),
            figure(
                "DM-VIO, one camera",
                0.062,
                Knowledge::NotStated,
                "SE(3), without loops, medians of five",
                DM_VIO,
            ),
            figure("Basalt, stereo", 0.082, Knowledge::NotStated, "without loops; given there", DM_VIO),
            figure(
                "cuVSLAM, stereo with IMU",
                0.12,
                Knowledge::Final,
                "Sim(3), with loops; needs a GPU",
                CUVSLAM,
            ),
            figure(
                "cuVSLAM, stereo with IMU",
                0.18,
                Knowledge::NotStated,
                "Sim(3), without loops; needs a GPU",
                CUVSLAM,
            ),
        ],
    },
];
