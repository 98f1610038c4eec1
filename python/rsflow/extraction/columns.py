"""The columns of the tables, each with its meaning: written as headers, explained on the report page."""

from __future__ import annotations

__all__ = ["INTEGERS", "MOTION", "OBJECTS", "TRAJECTORY", "VELOCITY", "WORDS", "meaning"]

# Columns that hold words.
WORDS = frozenset({"status", "segmentation_status", "camera_model", "std_without", "doubts", "state"})

# Columns that hold whole numbers; an empty cell is none.
INTEGERS = frozenset({"frame", "id", "age_frames", "missed_frames", "objects", "segment", "n_points"})

MOTION = {
    "frame": "number of the frame in the source, counted from 0",
    "t_s": "its time in seconds; nan where the source has no times",
    "dt_s": "time since the frame before that was measured",
    "dx_px": "displacement of the picture since the frame before, to the right: one vector for the whole frame, "
    "robust against what moves on its own",
    "dy_px": "the same, downwards",
    "dx_std_px": "standard deviation of dx_px; inf where it was not measured",
    "dy_std_px": "standard deviation of dy_px",
    "dxdy_cov_px2": "covariance of dx_px and dy_px",
    "gain": "change of contrast since the frame before that the displacement allows for",
    "offset": "change of brightness, in grey levels",
    "flow_mean_x_px": "mean of the valid dense flow, to the right (of large pictures over every second pixel each way)",
    "flow_mean_y_px": "the same, downwards",
    "flow_median_x_px": "median of the dense flow where it is valid, to the right",
    "flow_median_y_px": "the same, downwards",
    "flow_median_px": "median length of the dense flow",
    "flow_p95_px": "length that 95 % of the dense flow stay below",
    "flow_valid_share": "share of the pixels whose dense flow is valid, of those that count where there is a mask",
    "moving_share": "share of the pixels that move on their own, likewise",
    "objects": "number of moving things",
    "camera_dx_px": "motion of the static scene at the middle of the picture, to the right, from the dense flow",
    "camera_dy_px": "the same, downwards",
    "camera_rotation_rad": "its rotation about the line of sight, clockwise as seen",
    "camera_scale": "its magnification",
    "camera_model": "what the dense flow needed for it: translation, similarity, affine, homography, "
    "with +parallax where the scene was seen to have depth; static, none",
    "status": "ok, or why the displacement was not measured",
    "segmentation_status": "ok, or why moving and static were not told apart",
}

VELOCITY = {
    "frame": "number of the frame in the source",
    "t_s": "its time in seconds",
    "dt_s": "time since the frame before",
    "vx_m_s": "velocity of the camera over the ground, along the body's x axis: without a mounting the picture's, "
    "to the right",
    "vy_m_s": "the same, along the y axis: without a mounting down in the picture",
    "vz_m_s": "the same, along the z axis: without a mounting the line of sight",
    "vx_std_m_s": "standard deviation of vx_m_s; inf where it was not measured",
    "vy_std_m_s": "standard deviation of vy_m_s",
    "vz_std_m_s": "standard deviation of vz_m_s",
    "cov_xy_m2_s2": "covariance of vx_m_s and vy_m_s; the squares of the deviations are the variances",
    "cov_xz_m2_s2": "covariance of vx_m_s and vz_m_s",
    "cov_yz_m2_s2": "covariance of vy_m_s and vz_m_s",
    "height_m": "height over the ground that was used; of a range that above the plane",
    "height_std_m": "standard deviation of height_m; 0 also where none was stated",
    "rate_x_rad_s": "angular rate about the body's x axis since the frame before, as used: of the gyro, less what "
    "was learned of it, or solved for",
    "rate_y_rad_s": "the same about the y axis",
    "rate_z_rad_s": "the same about the z axis",
    "rate_x_std_rad_s": "standard deviation of rate_x_rad_s",
    "rate_y_std_rad_s": "standard deviation of rate_y_rad_s",
    "rate_z_std_rad_s": "standard deviation of rate_z_rad_s",
    "dx_px": "how far the ground went in the picture since the frame before, to the right",
    "dy_px": "the same, downwards",
    "n_points": "number of points that the velocity rests on",
    "status": "ok, or why it was not measured",
    "std_without": "what the standard deviations leave out since none was stated for it: height, focal_length, "
    "principal_point; empty where nothing",
    "doubts": "what is odd about the frame, in sentences that semicolons part; empty where nothing is",
}

TRAJECTORY = {
    "frame": "number of the frame in the source",
    "t_s": "its time in seconds",
    "segment": "counts the unbroken pieces: over a gap the velocity is carried on, and the deviations grow",
    "x_m": "way since the start, along the body's x axis at the start (the camera's by default), in metres",
    "y_m": "the same, along its y axis",
    "z_m": "the same, along its z axis (the line of sight by default)",
    "heading_rad": "turn about straight down since the start, clockwise as the camera sees the ground",
    "distance_m": "length of the way in the x-y plane, gaps carried on; nan in a gap",
    "x_std_m": "standard deviation of x_m, without that of what velocity.csv calls std_without; inf where a gap "
    "cannot be judged",
    "y_std_m": "standard deviation of y_m",
    "z_std_m": "standard deviation of z_m",
    "heading_std_rad": "standard deviation of heading_rad, of rates whose deviation was stated; 0 where none was",
    "distance_std_m": "standard deviation of distance_m; inf where a gap cannot be judged",
    "cov_xx_m2": "variance of x_m, which grows along the way: the square of x_std_m",
    "cov_xy_m2": "covariance of x_m and y_m",
    "cov_xz_m2": "covariance of x_m and z_m",
    "cov_yy_m2": "variance of y_m",
    "cov_yz_m2": "covariance of y_m and z_m",
    "cov_zz_m2": "variance of z_m; inf where the velocity along z was not known",
}

OBJECTS = {
    "frame": "number of the frame in the source",
    "t_s": "its time in seconds",
    "id": "number of the thing, the same from frame to frame",
    "age_frames": "for how many frames it has been seen",
    "x_px": "centre of its pixels, to the right",
    "y_px": "the same, downwards",
    "left_px": "left edge of its box",
    "top_px": "upper edge of its box",
    "width_px": "width of its box",
    "height_px": "height of its box",
    "area_px": "number of its pixels, 0 where it is hidden",
    "vx_px_per_frame": "its motion against the still surroundings, to the right, smoothed over the frames",
    "vy_px_per_frame": "the same, downwards",
    "state": "seen by itself, merged with others into one region, or hidden: then it is predicted",
    "missed_frames": "for how many frames it has been hidden",
    "x_std_px": "standard deviation of its believed place, to the right",
    "y_std_px": "the same, downwards",
    "vx_px_s": "vx_px_per_frame per second; nan where the source has no times",
    "vy_px_s": "the same, downwards",
    "vx_std_px_s": "standard deviation of vx_px_s; inf where its velocity is not known",
    "vy_std_px_s": "standard deviation of vy_px_s",
    "speed_px_s": "length of its velocity",
    "speed_std_px_s": "standard deviation of speed_px_s",
    "direction_rad": "where it goes: 0 to the right, growing clockwise as seen",
    "x_ground_px": "its place in the picture of the first frame, to the right: over the ground, where the camera moves",
    "y_ground_px": "the same, downwards",
    "travelled_px": "length of its path there",
    "vx_m_s": "its velocity over the ground to the right in the picture, with a camera that looks "
    "down to within 8 degrees and its height, or a scale",
    "vy_m_s": "the same, downwards",
    "vx_std_m_s": "standard deviation of vx_m_s, without that of the scale",
    "vy_std_m_s": "standard deviation of vy_m_s, likewise",
    "speed_m_s": "length of its velocity over the ground",
    "speed_std_m_s": "standard deviation of speed_m_s, without that of the scale",
    "travelled_m": "length of its path over the ground",
}

# What each status says to the reader of the report.
_MEANINGS = {
    "ok": "measured",
    "first_frame": "the first frame has none before it",
    "too_small": "the picture has too few pixels",
    "too_little_overlap": "the two frames share too little of the scene: the motion is too large",
    "no_texture": "nothing in the picture stands out of the noise",
    "aperture": "structure in one direction only: motion along it cannot be seen",
    "no_match": "the two frames do not show the same scene: a cut, or motion that is too large",
    "not_converged": "the estimate did not settle",
    "ambiguous": "the picture repeats: another displacement explains the frames as well",
    "time_not_increasing": "the frame is not later than the one before",
    "scene_cut": "the picture has nothing to do with the one before",
    "too_few_points": "too few points could be followed to fit a velocity and to judge it",
    "inconsistent": "fewer than half of the points move as one plane does",
    "no_height": "no height over the ground is known at this time",
    "repeated_frame": "the picture is the one before again: the next one is compared with that, over both intervals",
    "two_motions": "two motions hold for parts of the picture of similar size: either may be that of the ground",
    "no_camera_motion": "the dense flow does not tell the motion of the camera, so nothing is called moving",
    "no_ground": "the camera does not look at the ground",
}


def meaning(status: str) -> str:
    """Say in words what a status means."""
    return _MEANINGS.get(status, status.replace("_", " "))
