// Names of the entries that our EXR files have in their headers, the same in renders and datasets.
// Numbers are numbers (int or double); 64-bit seeds, which neither holds exactly, are text.
#pragma once

namespace itn::attribute {

inline constexpr const char* kVersion = "itn.version";           // of the program that wrote it
inline constexpr const char* kSceneSha256 = "itn.scene_sha256";  // of the scene's bytes
inline constexpr const char* kSigmaT = "itn.sigma_t";            // in 1/mm
inline constexpr const char* kAlbedo = "itn.albedo";
inline constexpr const char* kG = "itn.g";
inline constexpr const char* kPhase = "itn.phase";  // instead of g: an itn.v1.PhaseFunction
inline constexpr const char* kSpp = "itn.spp";
inline constexpr const char* kSeed = "itn.seed";
inline constexpr const char* kEstimates = "itn.estimates";
inline constexpr const char* kPilotSpp = "itn.pilot_spp";
inline constexpr const char* kValues =
    "itn.values";  // "light[0].scale=2 ...", instead of the scene's
inline constexpr const char* kPixels = "itn.pixels";  // all or object
inline constexpr const char* kTracer = "itn.tracer";  // wavefront or reference
inline constexpr const char* kPaths = "itn.paths";
inline constexpr const char* kSteps = "itn.steps";
inline constexpr const char* kInvalidSamples = "itn.invalid_samples";
inline constexpr const char* kLeaks = "itn.leaks";
// Attributes of datasets.
inline constexpr const char* kShape = "itn.shape";
inline constexpr const char* kSplit = "itn.split";
inline constexpr const char* kSunAzimuth = "itn.sun_azimuth_degrees";
inline constexpr const char* kRelativeNoise = "itn.relative_noise";  // of Y, on the object
inline constexpr const char* kItem = "itn.item";  // which item of the manifest, a digest
inline constexpr const char* kContents =
    "itn.contents_sha256";  // of all else, see contents_digest()
// Attribute of OpenEXR files whose colours have other primaries than sRGB's, while they are read: x
// and y of red, green, blue and white.
inline constexpr const char* kChromaticities = "itn.chromaticities";
// Attribute of panoramas whose first row of pixels stands at +y and whose last one at -y, as
// Mitsuba has them; else rows are as high as their pixels, and begin and end there.
inline constexpr const char* kRowsAtEnds = "itn.rows_at_ends";  // 1
// Attributes of photographs that were merged.
inline constexpr const char* kExposures = "itn.exposures";  // seconds, as text: 0.0125,0.05,0.2
inline constexpr const char* kMergeMethod = "itn.merge_method";  // debevec
inline constexpr const char* kResponse = "itn.response";         // estimate, srgb or linear

}  // namespace itn::attribute
