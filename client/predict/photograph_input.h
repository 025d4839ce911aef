// Photographs as people have them, made ready for a predictor.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "client/image/photograph_file.h"
#include "common/image/photograph.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// Left, top and size in pixels.
struct PixelRectangle {
  int x = 0, y = 0, width = 1, height = 1;
};

// What files do not say of themselves.
struct FileReading {
  std::optional<bool> is_linear;  // whether integers are linear, or sRGB; absent: as the file says
  std::string layer;              // of an OpenEXR file; empty: radiance_channels()

  // Whether the curve from light to a file's numbers is known: there is none, or it was said.
  bool knows_curve(bool encoded) const { return !encoded || is_linear.has_value(); }
};

// A photograph's file, of whose radiance nothing is negative: raw developments leave such pixels,
// which become 0, with a warning. The names of its channels: Y, or R, G, B. Throws Error as
// read_photograph() and radiance_channels() do.
struct PhotographContent {
  PhotographFile file;
  std::vector<std::string> channels;

  int width() const { return file.image.width; }
  int height() const { return file.image.height; }
};
PhotographContent read_content(const std::string& name, const FileReading& reading);

// The mask of the photograph `name` in the folder `masks`: of the same name, whatever the format.
// Throws Error (kIo) if there is none, or more than one.
std::string mask_in_folder(const std::string& masks, const std::string& name);

// The mask of a photograph in a file, or in a folder of such: in [0, 1], of its size. Throws Error
// as read_mask() does, kIo if the folder has none, kInvalidInput if it does not fit, is dark, or
// covers all.
std::vector<float> read_mask_for(const PhotographContent& content, const std::string& name,
                                 const std::string& mask);

// What is known of photographs, besides what is in their files.
struct PhotographOptions {
  FileReading reading;
  std::string mask;                 // a file, or a folder of such; empty: the photograph's own
  bool mask_by_background = false;  // mask_from_background()
  std::optional<Framing>
      framing;  // absent: files with a channel mask.Y kSquareWhole, others kObject
  std::optional<double> object_size;  // of the longest side, in mm
  std::optional<double> exposure;
  std::optional<PixelRectangle> gray_card;  // that lies flat beside the object, facing up
  double gray = 0.18;                       // its reflectance
};

// What a predictor is asked about: photograph and capture as in v1::PredictRequest.
struct PredictInput {
  std::string name;                   // of the file
  std::vector<std::string> channels;  // names: Y, or R, G, B
  FramedPhotograph photograph;
  v1::Capture capture;
  int width = 0, height = 0;  // before it was framed, in pixels
};

// A whole photograph with the object marked.
struct MarkedPhotograph {
  PhotographContent content;
  std::vector<float> pixels, mask;  // as of Photograph

  Photograph view() const {
    return {content.width(), content.height(), static_cast<int>(content.channels.size()), pixels,
            mask};
  }
};

// Reads the file ("-": standard input) and finds out where the object is. Throws as the next one,
// but for gray cards.
MarkedPhotograph read_marked(const std::string& file, const PhotographOptions& options);

// Part of the object that is at the top of what the file can hold; `clipped`: 1 where it is, of
// PhotographFile.
double clipped_part(const std::vector<unsigned char>& clipped, const std::vector<float>& mask);

// The radiance of a white card by channel, from the gray card that the options say. `name` is the
// file's. Throws Error (invalid input) if it cannot be used.
std::vector<double> white_of_card(const MarkedPhotograph& photograph, const std::string& name,
                                  const PhotographOptions& options);

// Reads the file ("-": standard input), finds out where the object is, frames it, and measures what
// limits the answer. Throws Error as read_photograph() does, and (invalid input) if there is no
// mask, it does not fit, or the gray card cannot be used.
PredictInput load_photograph(const std::string& file, const PhotographOptions& options);

// The images that the arguments name; of a folder those in it, by name. Throws Error (kIo) if there
// is none in one.
std::vector<std::string> photograph_files(const std::vector<std::string>& arguments);

}  // namespace itn
