"""CAN frame layouts. GENERATED from sensor_bus.dbc by `ground icd generate`: edit the DBC."""

from __future__ import annotations

import numpy as np

from flightsw.icd.frame_layout import FrameLayout as FrameLayout

ICD_VERSION = "2.2"

TIME_SYNC = FrameLayout(
    name="TIME_SYNC",
    frame_id=0x100,
    length=32,
    data_id=0x1A35,
    data_id_bytes=bytes((0x35, 0x1A)),
    sender="TIMING",
    struct_format="<qqfbB7xBH",
    field_names=(
        "t_gps_ns",
        "t_counter_ns",
        "sigma_ns",
        "leap_seconds",
        "status",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "t_counter_ns",
                "sigma_ns",
                "leap_seconds",
                "status",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<i8",
                "<f4",
                "i1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # t_counter_ns [ns]
                16,  # sigma_ns [ns]
                20,  # leap_seconds [s]
                21,  # status [-]
                29,  # counter [-]
                30,  # crc [-]
            ],
            "itemsize": 32,
        }
    ),
    counter_offset=29,
    crc_offset=30,
)

GNSS_POSITION = FrameLayout(
    name="GNSS_POSITION",
    frame_id=0x110,
    length=64,
    data_id=0x2B53,
    data_id_bytes=bytes((0x53, 0x2B)),
    sender="GNSS",
    struct_format="<qqdddfffBB7xBH",
    field_names=(
        "t_gps_ns",
        "t_counter_ns",
        "x_itrf_m",
        "y_itrf_m",
        "z_itrf_m",
        "sigma_x_m",
        "sigma_y_m",
        "sigma_z_m",
        "satellites",
        "fix_type",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "t_counter_ns",
                "x_itrf_m",
                "y_itrf_m",
                "z_itrf_m",
                "sigma_x_m",
                "sigma_y_m",
                "sigma_z_m",
                "satellites",
                "fix_type",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<i8",
                "<f8",
                "<f8",
                "<f8",
                "<f4",
                "<f4",
                "<f4",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # t_counter_ns [ns]
                16,  # x_itrf_m [m]
                24,  # y_itrf_m [m]
                32,  # z_itrf_m [m]
                40,  # sigma_x_m [m]
                44,  # sigma_y_m [m]
                48,  # sigma_z_m [m]
                52,  # satellites [-]
                53,  # fix_type [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

GNSS_VELOCITY = FrameLayout(
    name="GNSS_VELOCITY",
    frame_id=0x111,
    length=64,
    data_id=0x4C8D,
    data_id_bytes=bytes((0x8D, 0x4C)),
    sender="GNSS",
    struct_format="<qdddfff17xBH",
    field_names=(
        "t_gps_ns",
        "vx_itrf_mps",
        "vy_itrf_mps",
        "vz_itrf_mps",
        "sigma_vx_mps",
        "sigma_vy_mps",
        "sigma_vz_mps",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "vx_itrf_mps",
                "vy_itrf_mps",
                "vz_itrf_mps",
                "sigma_vx_mps",
                "sigma_vy_mps",
                "sigma_vz_mps",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f8",
                "<f8",
                "<f8",
                "<f4",
                "<f4",
                "<f4",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # vx_itrf_mps [m/s]
                16,  # vy_itrf_mps [m/s]
                24,  # vz_itrf_mps [m/s]
                32,  # sigma_vx_mps [m/s]
                36,  # sigma_vy_mps [m/s]
                40,  # sigma_vz_mps [m/s]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

BURN = FrameLayout(
    name="BURN",
    frame_id=0x120,
    length=64,
    data_id=0x9D4B,
    data_id_bytes=bytes((0x4B, 0x9D)),
    sender="PROPULSION",
    struct_format="<qqdddfffBB7xBH",
    field_names=(
        "t_start_gps_ns",
        "duration_ns",
        "dv_x_mps",
        "dv_y_mps",
        "dv_z_mps",
        "sigma_x_mps",
        "sigma_y_mps",
        "sigma_z_mps",
        "frame",
        "burn_id",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_start_gps_ns",
                "duration_ns",
                "dv_x_mps",
                "dv_y_mps",
                "dv_z_mps",
                "sigma_x_mps",
                "sigma_y_mps",
                "sigma_z_mps",
                "frame",
                "burn_id",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<i8",
                "<f8",
                "<f8",
                "<f8",
                "<f4",
                "<f4",
                "<f4",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_start_gps_ns [ns]
                8,  # duration_ns [ns]
                16,  # dv_x_mps [m/s]
                24,  # dv_y_mps [m/s]
                32,  # dv_z_mps [m/s]
                40,  # sigma_x_mps [m/s]
                44,  # sigma_y_mps [m/s]
                48,  # sigma_z_mps [m/s]
                52,  # frame [-]
                53,  # burn_id [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

ATTITUDE = FrameLayout(
    name="ATTITUDE",
    frame_id=0x130,
    length=32,
    data_id=0xA6C7,
    data_id_bytes=bytes((0xC7, 0xA6)),
    sender="AOCS",
    struct_format="<qfffff1xBH",
    field_names=(
        "t_gps_ns",
        "q_w",
        "q_x",
        "q_y",
        "q_z",
        "sigma_rad",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "q_w",
                "q_x",
                "q_y",
                "q_z",
                "sigma_rad",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # q_w [-]
                12,  # q_x [-]
                16,  # q_y [-]
                20,  # q_z [-]
                24,  # sigma_rad [rad]
                29,  # counter [-]
                30,  # crc [-]
            ],
            "itemsize": 32,
        }
    ),
    counter_offset=29,
    crc_offset=30,
)

NAV_COMMAND = FrameLayout(
    name="NAV_COMMAND",
    frame_id=0x140,
    length=8,
    data_id=0xB8E1,
    data_id_bytes=bytes((0xE1, 0xB8)),
    sender="COMMANDER",
    struct_format="<BBB2xBH",
    field_names=(
        "command",
        "target",
        "value",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "command",
                "target",
                "value",
                "counter",
                "crc",
            ],
            "formats": [
                "u1",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # command [-]
                1,  # target [-]
                2,  # value [-]
                5,  # counter [-]
                6,  # crc [-]
            ],
            "itemsize": 8,
        }
    ),
    counter_offset=5,
    crc_offset=6,
)

GNSS_EPOCH = FrameLayout(
    name="GNSS_EPOCH",
    frame_id=0x150,
    length=32,
    data_id=0x238D,
    data_id_bytes=bytes((0x8D, 0x23)),
    sender="GNSS",
    struct_format="<qqB12xBH",
    field_names=(
        "t_gps_ns",
        "t_counter_ns",
        "count",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "t_counter_ns",
                "count",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<i8",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # t_counter_ns [ns]
                16,  # count [-]
                29,  # counter [-]
                30,  # crc [-]
            ],
            "itemsize": 32,
        }
    ),
    counter_offset=29,
    crc_offset=30,
)

GNSS_RANGES = FrameLayout(
    name="GNSS_RANGES",
    frame_id=0x151,
    length=64,
    data_id=0x5CBD,
    data_id_bytes=bytes((0xBD, 0x5C)),
    sender="GNSS",
    struct_format="<qBdfBBBdfBBBdfBBB7xBH",
    field_names=(
        "t_gps_ns",
        "count",
        "range_0_m",
        "sigma_0_m",
        "satellite_0",
        "constellation_0",
        "cn0_0_dbhz",
        "range_1_m",
        "sigma_1_m",
        "satellite_1",
        "constellation_1",
        "cn0_1_dbhz",
        "range_2_m",
        "sigma_2_m",
        "satellite_2",
        "constellation_2",
        "cn0_2_dbhz",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "count",
                "range_0_m",
                "sigma_0_m",
                "satellite_0",
                "constellation_0",
                "cn0_0_dbhz",
                "range_1_m",
                "sigma_1_m",
                "satellite_1",
                "constellation_1",
                "cn0_1_dbhz",
                "range_2_m",
                "sigma_2_m",
                "satellite_2",
                "constellation_2",
                "cn0_2_dbhz",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "u1",
                "<f8",
                "<f4",
                "u1",
                "u1",
                "u1",
                "<f8",
                "<f4",
                "u1",
                "u1",
                "u1",
                "<f8",
                "<f4",
                "u1",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # count [-]
                9,  # range_0_m [m]
                17,  # sigma_0_m [m]
                21,  # satellite_0 [-]
                22,  # constellation_0 [-]
                23,  # cn0_0_dbhz [dB-Hz]
                24,  # range_1_m [m]
                32,  # sigma_1_m [m]
                36,  # satellite_1 [-]
                37,  # constellation_1 [-]
                38,  # cn0_1_dbhz [dB-Hz]
                39,  # range_2_m [m]
                47,  # sigma_2_m [m]
                51,  # satellite_2 [-]
                52,  # constellation_2 [-]
                53,  # cn0_2_dbhz [dB-Hz]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

GNSS_EPHEMERIS = FrameLayout(
    name="GNSS_EPHEMERIS",
    frame_id=0x152,
    length=64,
    data_id=0x79B1,
    data_id_bytes=bytes((0xB1, 0x79)),
    sender="GNSS",
    struct_format="<qddddffffHBBBBH",
    field_names=(
        "t_ref_gps_ns",
        "x_itrf_m",
        "y_itrf_m",
        "z_itrf_m",
        "clock_m",
        "vx_itrf_mps",
        "vy_itrf_mps",
        "vz_itrf_mps",
        "clock_drift_mps",
        "issue",
        "satellite",
        "constellation",
        "status",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_ref_gps_ns",
                "x_itrf_m",
                "y_itrf_m",
                "z_itrf_m",
                "clock_m",
                "vx_itrf_mps",
                "vy_itrf_mps",
                "vz_itrf_mps",
                "clock_drift_mps",
                "issue",
                "satellite",
                "constellation",
                "status",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f8",
                "<f8",
                "<f8",
                "<f8",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<u2",
                "u1",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_ref_gps_ns [ns]
                8,  # x_itrf_m [m]
                16,  # y_itrf_m [m]
                24,  # z_itrf_m [m]
                32,  # clock_m [m]
                40,  # vx_itrf_mps [m/s]
                44,  # vy_itrf_mps [m/s]
                48,  # vz_itrf_mps [m/s]
                52,  # clock_drift_mps [m/s]
                56,  # issue [-]
                58,  # satellite [-]
                59,  # constellation [-]
                60,  # status [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

CROSSLINK_EPHEMERIS = FrameLayout(
    name="CROSSLINK_EPHEMERIS",
    frame_id=0x160,
    length=64,
    data_id=0x3857,
    data_id_bytes=bytes((0x57, 0x38)),
    sender="CROSSLINK",
    struct_format="<qdddfffdfBBH1xBH",
    field_names=(
        "t_ref_gps_ns",
        "x_gcrf_m",
        "y_gcrf_m",
        "z_gcrf_m",
        "vx_gcrf_mps",
        "vy_gcrf_mps",
        "vz_gcrf_mps",
        "clock_m",
        "clock_rate_mps",
        "satellite",
        "healthy",
        "issue",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_ref_gps_ns",
                "x_gcrf_m",
                "y_gcrf_m",
                "z_gcrf_m",
                "vx_gcrf_mps",
                "vy_gcrf_mps",
                "vz_gcrf_mps",
                "clock_m",
                "clock_rate_mps",
                "satellite",
                "healthy",
                "issue",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f8",
                "<f8",
                "<f8",
                "<f4",
                "<f4",
                "<f4",
                "<f8",
                "<f4",
                "u1",
                "u1",
                "<u2",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_ref_gps_ns [ns]
                8,  # x_gcrf_m [m]
                16,  # y_gcrf_m [m]
                24,  # z_gcrf_m [m]
                32,  # vx_gcrf_mps [m/s]
                36,  # vy_gcrf_mps [m/s]
                40,  # vz_gcrf_mps [m/s]
                44,  # clock_m [m]
                52,  # clock_rate_mps [m/s]
                56,  # satellite [-]
                57,  # healthy [-]
                58,  # issue [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

CROSSLINK_RANGES = FrameLayout(
    name="CROSSLINK_RANGES",
    frame_id=0x161,
    length=64,
    data_id=0x7825,
    data_id_bytes=bytes((0x25, 0x78)),
    sender="CROSSLINK",
    struct_format="<qdddddfBBBBBBHBBH",
    field_names=(
        "t_gps_ns",
        "range_1_m",
        "range_2_m",
        "range_3_m",
        "range_4_m",
        "range_5_m",
        "sigma_m",
        "receiver",
        "sender_1",
        "sender_2",
        "sender_3",
        "sender_4",
        "sender_5",
        "links_total",
        "two_way",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "range_1_m",
                "range_2_m",
                "range_3_m",
                "range_4_m",
                "range_5_m",
                "sigma_m",
                "receiver",
                "sender_1",
                "sender_2",
                "sender_3",
                "sender_4",
                "sender_5",
                "links_total",
                "two_way",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f8",
                "<f8",
                "<f8",
                "<f8",
                "<f8",
                "<f4",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "<u2",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # range_1_m [m]
                16,  # range_2_m [m]
                24,  # range_3_m [m]
                32,  # range_4_m [m]
                40,  # range_5_m [m]
                48,  # sigma_m [m]
                52,  # receiver [-]
                53,  # sender_1 [-]
                54,  # sender_2 [-]
                55,  # sender_3 [-]
                56,  # sender_4 [-]
                57,  # sender_5 [-]
                58,  # links_total [-]
                60,  # two_way [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

NAV_STATE = FrameLayout(
    name="NAV_STATE",
    frame_id=0x200,
    length=64,
    data_id=0x65E2,
    data_id_bytes=bytes((0xE2, 0x65)),
    sender="FLIGHT",
    struct_format="<qddddddBBB2xBH",
    field_names=(
        "t_gps_ns",
        "x_gcrf_m",
        "y_gcrf_m",
        "z_gcrf_m",
        "vx_gcrf_mps",
        "vy_gcrf_mps",
        "vz_gcrf_mps",
        "mode",
        "validity",
        "flag_state",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "x_gcrf_m",
                "y_gcrf_m",
                "z_gcrf_m",
                "vx_gcrf_mps",
                "vy_gcrf_mps",
                "vz_gcrf_mps",
                "mode",
                "validity",
                "flag_state",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f8",
                "<f8",
                "<f8",
                "<f8",
                "<f8",
                "<f8",
                "u1",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # x_gcrf_m [m]
                16,  # y_gcrf_m [m]
                24,  # z_gcrf_m [m]
                32,  # vx_gcrf_mps [m/s]
                40,  # vy_gcrf_mps [m/s]
                48,  # vz_gcrf_mps [m/s]
                56,  # mode [-]
                57,  # validity [-]
                58,  # flag_state [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

INTEGRITY = FrameLayout(
    name="INTEGRITY",
    frame_id=0x201,
    length=64,
    data_id=0x7F19,
    data_id_bytes=bytes((0x19, 0x7F)),
    sender="FLIGHT",
    struct_format="<qdffQffffBBBBHBBBB3xBH",
    field_names=(
        "t_gps_ns",
        "bound_m",
        "limit_m",
        "bound_3d_m",
        "alerts",
        "fix_age_s",
        "outage_age_s",
        "flag_age_s",
        "nis",
        "mode",
        "flag_state",
        "verdict",
        "driver",
        "accepted_streak",
        "stored_da_coverage_pct",
        "da_source",
        "certificate",
        "uncovered",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "bound_m",
                "limit_m",
                "bound_3d_m",
                "alerts",
                "fix_age_s",
                "outage_age_s",
                "flag_age_s",
                "nis",
                "mode",
                "flag_state",
                "verdict",
                "driver",
                "accepted_streak",
                "stored_da_coverage_pct",
                "da_source",
                "certificate",
                "uncovered",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f8",
                "<f4",
                "<f4",
                "<u8",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "u1",
                "u1",
                "u1",
                "u1",
                "<u2",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # bound_m [m]
                16,  # limit_m [m]
                20,  # bound_3d_m [m]
                24,  # alerts [-]
                32,  # fix_age_s [s]
                36,  # outage_age_s [s]
                40,  # flag_age_s [s]
                44,  # nis [-]
                48,  # mode [-]
                49,  # flag_state [-]
                50,  # verdict [-]
                51,  # driver [-]
                52,  # accepted_streak [-]
                54,  # stored_da_coverage_pct [%]
                55,  # da_source [-]
                56,  # certificate [-]
                57,  # uncovered [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

FLIGHT_HEARTBEAT = FrameLayout(
    name="FLIGHT_HEARTBEAT",
    frame_id=0x202,
    length=32,
    data_id=0x918E,
    data_id_bytes=bytes((0x8E, 0x91)),
    sender="FLIGHT",
    struct_format="<QqIIB4xBH",
    field_names=(
        "tick",
        "t_counter_ns",
        "slips",
        "rejected",
        "mode",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "tick",
                "t_counter_ns",
                "slips",
                "rejected",
                "mode",
                "counter",
                "crc",
            ],
            "formats": [
                "<u8",
                "<i8",
                "<u4",
                "<u4",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # tick [-]
                8,  # t_counter_ns [ns]
                16,  # slips [-]
                20,  # rejected [-]
                24,  # mode [-]
                29,  # counter [-]
                30,  # crc [-]
            ],
            "itemsize": 32,
        }
    ),
    counter_offset=29,
    crc_offset=30,
)

TIME_TO_FLAG = FrameLayout(
    name="TIME_TO_FLAG",
    frame_id=0x203,
    length=32,
    data_id=0xC88D,
    data_id_bytes=bytes((0x8D, 0xC8)),
    sender="FLIGHT",
    struct_format="<qffBB11xBH",
    field_names=(
        "t_gps_ns",
        "time_to_flag_s",
        "prediction_age_s",
        "governing",
        "in_outage",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "time_to_flag_s",
                "prediction_age_s",
                "governing",
                "in_outage",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f4",
                "<f4",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # time_to_flag_s [s]
                12,  # prediction_age_s [s]
                16,  # governing [-]
                17,  # in_outage [-]
                29,  # counter [-]
                30,  # crc [-]
            ],
            "itemsize": 32,
        }
    ),
    counter_offset=29,
    crc_offset=30,
)

GNSS_CHECK = FrameLayout(
    name="GNSS_CHECK",
    frame_id=0x210,
    length=64,
    data_id=0xB165,
    data_id_bytes=bytes((0x65, 0xB1)),
    sender="FLIGHT",
    struct_format="<qfffffffffffBBBBBBB2xBH",
    field_names=(
        "t_gps_ns",
        "statistic",
        "threshold",
        "protection_east_m",
        "protection_north_m",
        "protection_up_m",
        "limit_east_m",
        "limit_north_m",
        "limit_up_m",
        "sigma_east_m",
        "sigma_north_m",
        "sigma_up_m",
        "gnss_verdict",
        "used",
        "excluded",
        "refused",
        "dof",
        "available",
        "offered",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "statistic",
                "threshold",
                "protection_east_m",
                "protection_north_m",
                "protection_up_m",
                "limit_east_m",
                "limit_north_m",
                "limit_up_m",
                "sigma_east_m",
                "sigma_north_m",
                "sigma_up_m",
                "gnss_verdict",
                "used",
                "excluded",
                "refused",
                "dof",
                "available",
                "offered",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # statistic [-]
                12,  # threshold [-]
                16,  # protection_east_m [m]
                20,  # protection_north_m [m]
                24,  # protection_up_m [m]
                28,  # limit_east_m [m]
                32,  # limit_north_m [m]
                36,  # limit_up_m [m]
                40,  # sigma_east_m [m]
                44,  # sigma_north_m [m]
                48,  # sigma_up_m [m]
                52,  # gnss_verdict [-]
                53,  # used [-]
                54,  # excluded [-]
                55,  # refused [-]
                56,  # dof [-]
                57,  # available [-]
                58,  # offered [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

GNSS_USED = FrameLayout(
    name="GNSS_USED",
    frame_id=0x211,
    length=48,
    data_id=0xC41F,
    data_id_bytes=bytes((0x1F, 0xC4)),
    sender="FLIGHT",
    struct_format="<qQQQQ5xBH",
    field_names=(
        "t_gps_ns",
        "gps",
        "glonass",
        "galileo",
        "beidou",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "gps",
                "glonass",
                "galileo",
                "beidou",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<u8",
                "<u8",
                "<u8",
                "<u8",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # gps [-]
                16,  # glonass [-]
                24,  # galileo [-]
                32,  # beidou [-]
                45,  # counter [-]
                46,  # crc [-]
            ],
            "itemsize": 48,
        }
    ),
    counter_offset=45,
    crc_offset=46,
)

GNSS_EXCLUDED = FrameLayout(
    name="GNSS_EXCLUDED",
    frame_id=0x212,
    length=48,
    data_id=0xE609,
    data_id_bytes=bytes((0x09, 0xE6)),
    sender="FLIGHT",
    struct_format="<qQQQQ5xBH",
    field_names=(
        "t_gps_ns",
        "gps",
        "glonass",
        "galileo",
        "beidou",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "gps",
                "glonass",
                "galileo",
                "beidou",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<u8",
                "<u8",
                "<u8",
                "<u8",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # gps [-]
                16,  # glonass [-]
                24,  # galileo [-]
                32,  # beidou [-]
                45,  # counter [-]
                46,  # crc [-]
            ],
            "itemsize": 48,
        }
    ),
    counter_offset=45,
    crc_offset=46,
)

CROSSLINK_STATUS = FrameLayout(
    name="CROSSLINK_STATUS",
    frame_id=0x218,
    length=64,
    data_id=0xDF4B,
    data_id_bytes=bytes((0x4B, 0xDF)),
    sender="FLIGHT",
    struct_format="<qIIffffffHHHHHBBBBBBBIBH",
    field_names=(
        "t_gps_ns",
        "faulty",
        "named",
        "own_statistic",
        "own_threshold",
        "network_statistic",
        "network_threshold",
        "weakest_m",
        "epoch_age_s",
        "links",
        "own_links",
        "rank",
        "parameters",
        "incomplete",
        "own_state",
        "majority",
        "own",
        "satellites",
        "network_worst",
        "own_peer",
        "weakest",
        "unmonitored",
        "counter",
        "crc",
    ),
    dtype=np.dtype(
        {
            "names": [
                "t_gps_ns",
                "faulty",
                "named",
                "own_statistic",
                "own_threshold",
                "network_statistic",
                "network_threshold",
                "weakest_m",
                "epoch_age_s",
                "links",
                "own_links",
                "rank",
                "parameters",
                "incomplete",
                "own_state",
                "majority",
                "own",
                "satellites",
                "network_worst",
                "own_peer",
                "weakest",
                "unmonitored",
                "counter",
                "crc",
            ],
            "formats": [
                "<i8",
                "<u4",
                "<u4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<f4",
                "<u2",
                "<u2",
                "<u2",
                "<u2",
                "<u2",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "u1",
                "<u4",
                "u1",
                "<u2",
            ],
            "offsets": [
                0,  # t_gps_ns [ns]
                8,  # faulty [-]
                12,  # named [-]
                16,  # own_statistic [-]
                20,  # own_threshold [-]
                24,  # network_statistic [-]
                28,  # network_threshold [-]
                32,  # weakest_m [m]
                36,  # epoch_age_s [s]
                40,  # links [-]
                42,  # own_links [-]
                44,  # rank [-]
                46,  # parameters [-]
                48,  # incomplete [-]
                50,  # own_state [-]
                51,  # majority [-]
                52,  # own [-]
                53,  # satellites [-]
                54,  # network_worst [-]
                55,  # own_peer [-]
                56,  # weakest [-]
                57,  # unmonitored [-]
                61,  # counter [-]
                62,  # crc [-]
            ],
            "itemsize": 64,
        }
    ),
    counter_offset=61,
    crc_offset=62,
)

LAYOUTS: dict[int, FrameLayout] = {
    TIME_SYNC.frame_id: TIME_SYNC,
    GNSS_POSITION.frame_id: GNSS_POSITION,
    GNSS_VELOCITY.frame_id: GNSS_VELOCITY,
    BURN.frame_id: BURN,
    ATTITUDE.frame_id: ATTITUDE,
    NAV_COMMAND.frame_id: NAV_COMMAND,
    GNSS_EPOCH.frame_id: GNSS_EPOCH,
    GNSS_RANGES.frame_id: GNSS_RANGES,
    GNSS_EPHEMERIS.frame_id: GNSS_EPHEMERIS,
    CROSSLINK_EPHEMERIS.frame_id: CROSSLINK_EPHEMERIS,
    CROSSLINK_RANGES.frame_id: CROSSLINK_RANGES,
    NAV_STATE.frame_id: NAV_STATE,
    INTEGRITY.frame_id: INTEGRITY,
    FLIGHT_HEARTBEAT.frame_id: FLIGHT_HEARTBEAT,
    TIME_TO_FLAG.frame_id: TIME_TO_FLAG,
    GNSS_CHECK.frame_id: GNSS_CHECK,
    GNSS_USED.frame_id: GNSS_USED,
    GNSS_EXCLUDED.frame_id: GNSS_EXCLUDED,
    CROSSLINK_STATUS.frame_id: CROSSLINK_STATUS,
}
