"""What the figures of an evaluation are called, and what each means."""

from __future__ import annotations

from collections.abc import Mapping

from dynhair.evaluation.edge_motion import EDGE, SMOOTHING, WINDOW
from dynhair.evaluation.fid import FID_IMAGES
from dynhair.evaluation.hair_motion import NEAREST_POINTS
from dynhair.evaluation.hair_samples import POINTS, STRANDS
from dynhair.evaluation.metrics import PSNR_CEILING, SILHOUETTE_THRESHOLD
from dynhair.evaluation.perception import LEAST_FACE, PERCEPTION_STRIDE, VGG_IMAGES
from dynhair.evaluation.regions import BAND
from dynhair.evaluation.settling import SETTLED
from dynhair.evaluation.strand_physics import LEAST_SPEED
from dynhair.evaluation.swing import LEAST_CORRELATION, MOST_LAG
from dynhair.evaluation.torso import BODY_FOLLOW, FAINT_HAIR, HAIR_MARGIN, LEAST_EDGES

MOTION = "hair_motion_explained"
FLICKER = "hair_tlpips_excess"
STILL_OVERLAP, STILL_CHANGE = "hair_tiou_still_truth", "hair_tlpips_still_truth"
STILL_FIGURES = (STILL_OVERLAP, STILL_CHANGE)
"""What noise alone does to the truth's own figures from frame to frame."""

TEMPORAL_FIGURES = ("hair_tiou", "hair_tiou_truth", FLICKER, *STILL_FIGURES)
HAIR_FIGURES = ("hair_psnr", "hair_ssim", "hair_iou", *TEMPORAL_FIGURES)
"""The figures of hair that need hair masks."""

SILHOUETTE_FIGURES = ("hair_iou", "hair_tiou")
"""The figures that need the hair's coverage in the method's own images."""

LPIPS_FIGURES = ("lpips", "face_lpips", FLICKER, STILL_CHANGE)
FID_FIGURES = ("fid", "hair_fid")
FACE_FIGURES = ("face_psnr", "face_ssim", "face_lpips")
BOUNDARY_FIGURES = ("boundary_psnr", "boundary_label_error")
PHYSICS_FIGURES = ("ver", "cts", "p95_disp", "amd")
SPEED_FIGURES = ("hair_velocity", "hair_acceleration")
PHYSICS_TRUTH = tuple(f"{name}_truth" for name in PHYSICS_FIGURES)
SPEED_TRUTH = tuple(f"{name}_truth" for name in SPEED_FIGURES)
TRUTH_FIGURES = (*PHYSICS_TRUTH, *SPEED_TRUTH, "settling_s_truth")
"""Those of the true strands by themselves."""

PENETRATION_FIGURES = ("penetration_rate", "penetration_depth_mm")
SWING_FIGURES = ("tip_error_mm", "phase_lag_ms", "settling_s")
STRAND_FIGURES = (MOTION, *SWING_FIGURES, *PHYSICS_FIGURES, *PENETRATION_FIGURES, "stretch")
"""The figures that a method without strands cannot have."""

MOTION_FIGURES = (*STRAND_FIGURES, *SPEED_FIGURES, *TRUTH_FIGURES)
"""The figures that are of no view."""

TORSO_MOTION, TORSO_MOTION_TRUTH = "torso_motion", "torso_motion_truth"
TORSO_FIGURES = (TORSO_MOTION, TORSO_MOTION_TRUTH)

DEFINITIONS: Mapping[str, str] = {
    "psnr": "dB, -10 log10(MSE) over all pixels and channels of the sRGB image in [0, 1], "
    f"at most {PSNR_CEILING:g}; mean over images",
    "ssim": "structural similarity, Gaussian window of 11 pixels, sigma 1.5, K1 0.01, K2 0.03, over channels and "
    "all pixels whose window is inside the image; mean over images",
    "hair_psnr": "psnr over the pixels of the truth's hair silhouette; mean over the images that have one",
    "hair_ssim": "the ssim map of the whole image averaged over those of its pixels in the truth's hair silhouette; "
    "mean over the images that have one",
    "hair_iou": "intersection over union of the avatar's and the truth's hair silhouettes "
    f"(pixels with coverage above {SILHOUETTE_THRESHOLD:g}); mean over images",
    "hair_tiou": "intersection over union of the avatar's hair silhouettes in frames t and t + 1 of one camera; "
    "mean over pairs",
    "hair_tiou_truth": "the same of the truth's hair silhouettes, to which hair_tiou should come close",
    FLICKER: "the paper's tLPIPS_ex: LPIPS (0.1, AlexNet) of the avatar's images in frames t and t + 1 of one camera, "
    "black outside the truth's hair masks of both frames, less that of the truth's images there; above 0 the avatar "
    "flickers, below it is stiff; mean over pairs",
    STILL_OVERLAP: "hair_tiou_truth over the frames before a motion moves the head, where noise of the "
    "truth's masks alone makes it less than 1: by up to this much silhouettes without noise overlap more than the "
    "truth's; mean over pairs",
    STILL_CHANGE: f"LPIPS of the truth's images as in {FLICKER} over these frames, where noise alone makes it more "
    "than 0: by up to this much images without noise are below 0 there; mean over pairs",
    MOTION: "1 - mean |d - g| / mean |g| over frames and points of the true strands, in the head's frame: g is a "
    f"point's displacement from rest, d the avatar's, blended by inverse distance from its {NEAREST_POINTS} "
    "strand points nearest to that point at rest; 1 is the true motion, 0 a rigid hairstyle",
    "tip_error_mm": "mm, distance of the tips of the true strands from where the avatar's hair would take them "
    f"(blended as for {MOTION}); mean over tips and frames",
    "phase_lag_ms": "ms by which the avatar's hair swings after the truth's: lag of the greatest correlation, at "
    f"least {LEAST_CORRELATION:g} and within {MOST_LAG:g} s, of the mean positions of the tips of tip_error_mm in the "
    "head's frame, along the axis on which the truth's vary most; mean over test segments",
    "settling_s": "s from a sudden stop of the head until the mean speed of these tips stays below "
    f"{SETTLED:.0%} of its greatest after the stop; mean over test segments with such a stop",
    "settling_s_truth": "the same of the true tips",
    "hair_velocity": "m/s, mean distance of hair points in frame t from the nearest in t + 1, in the head's frame, "
    f"times frames per second; of at most {STRANDS} strands at {POINTS} points, or as many of the Gaussians that lie "
    "in the truth's hair silhouettes in the segment's first frame; mean over pairs",
    "hair_velocity_truth": "the same of the true strands",
    "hair_acceleration": "m/s^2, mean change of that velocity from pair to pair, times frames per second",
    "hair_acceleration_truth": "the same of the true strands",
    "ver": "velocity explosion ratio: greatest over median speed of the points of hair_velocity's strands, in the "
    f"head's frame, {LEAST_SPEED:g} m/s added to the median; over all pairs of frames",
    "ver_truth": "the same of the true strands",
    "cts": "curvature temporal smoothness: m, mean change of a point's second difference along the strand from frame "
    "to frame, of the same points",
    "cts_truth": "the same of the true strands",
    "p95_disp": "displacement spike: m, 95th percentile over pairs of frames of the greatest displacement of these "
    "points",
    "p95_disp_truth": "the same of the true strands",
    "amd": "angular momentum drift: m^2/s of unit mass a point, mean over frames of |L_t - L_1|, L_t the sum over "
    "these points of their arms from their mean times their velocities; L_1 of each segment's own first frame",
    "amd_truth": "the same of the true strands",
    "penetration_rate": "share of these points, roots aside, that are inside the tracked mesh of head and body, in "
    "[0, 1]",
    "penetration_depth_mm": "mm, mean distance of the points inside from its surface",
    "stretch": "sqrt(sum (l - l_0)^2 / sum l_0^2) over all segments of the strands, of length l and at rest l_0, and "
    "all frames: strands that are all longer by a share score that share",
    "lpips": "learned perceptual distance of whole images in [0, 1] (LPIPS 0.1, AlexNet), lower is better; mean over "
    f"the images of one evaluated frame in {PERCEPTION_STRIDE}, from a segment's first",
    "lpips_vgg": f"the same with VGG16, of {VGG_IMAGES} images of each test segment, spread evenly over frames and "
    "views",
    "fid": "Frechet inception distance: of the normal distributions of features of Inception v3 (2015, 2048 of the "
    f"last pooling) in the avatar's images and in the truth's, {FID_IMAGES} of each test segment, spread evenly; so "
    "few images raise it, so it compares only at equal samples",
    "flip": "FLIP (2020, for low dynamic range, 67 pixels a degree): mean over pixels, in [0, 1], lower is better; "
    "mean over the images of lpips",
    "hair_lpips": "lpips of images that are black outside the truth's hair mask, as the paper's are; not cropped; mean "
    "over the images of lpips that show hair",
    "hair_lpips_vgg": "lpips_vgg of these images",
    "hair_fid": "fid of these images",
    "face_psnr": "psnr over the face: pixels whose centre is in the convex hull of the frame's projected 3-D "
    "landmarks (66 of iBUG, brows to chin), in views from before the face, less the truth's hair silhouette; mean over "
    "the images that have any",
    "face_ssim": "the ssim map of the whole image averaged over the pixels of face_psnr; mean over the images that "
    "have any",
    "face_lpips": "lpips of the least square crop round the landmarks' hull, hair in it included, moved to lie in the "
    f"image; enlarged to {LEAST_FACE} pixels (bicubic) where it is smaller; the same crop of avatar and truth; mean "
    "over the images, among those of lpips, that show a face",
    "boundary_psnr": f"psnr over the pixels within {BAND:.2%} of the image's longer side of the edge of the truth's "
    "hair silhouette, on both sides, one pixel at least; mean over the images that have any",
    "boundary_label_error": "mean of |h - h*| and |b - b*|, each over the pixels of boundary_psnr: h and b are the "
    "avatar's visible coverage of hair and of head and body, h* the truth's hair mask and b* what else its mask "
    "covers, (mask - h*)+; mean over images",
    TORSO_MOTION: "pixels by which the avatar's torso has moved in its images since the segment's first frame: mean "
    "displacement across the edges of its own first image, mean over the images of later frames. Torso: the tracked "
    f"mesh's faces that follow the head by less than {BODY_FOLLOW:g}, projected in the first frame, less the hull of "
    f"the rest of the mesh in both frames, less pixels within {HAIR_MARGIN} of hair (coverage above {FAINT_HAIR:g}) in "
    f"the avatar's or the truth's images of both frames. Edges: luma, smoothed by a Gaussian of {SMOOTHING:g} pixel, "
    f"changes by more than {EDGE:g} a pixel; at least {LEAST_EDGES} in a view. Displacement: Lucas-Kanade with a "
    f"change of brightness, Gaussian window of {WINDOW:g} pixels",
    TORSO_MOTION_TRUTH: "the same of the truth's images over the same pixels: where the torso rests, what noise and "
    "shadows make of it",
}
"""What each figure means, in the order of reports."""
