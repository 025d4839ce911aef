// How paths that have ended get onto the film.
#pragma once

#include <cstddef>
#include <vector>

#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"
#include "server/tracer/wavefront/walk/paths.h"

namespace itn::tracer {

class PathRecorder {
 public:
  // `paths` has the columns that the request needs.
  PathRecorder(const RenderRequest& request, const Paths& paths, FilmWriter& film);

  // Of the path in a slot.
  void record(size_t slot);

 private:
  // Where a derivative is collected, and its control variate, if it has one.
  struct DerivativeColumns {
    const FloatColumn* collected;
    const FloatColumn* control_variate = nullptr;
  };

  const Paths& paths_;
  FilmWriter& film_;
  PathEstimate estimate_;                       // of the path that is recorded
  std::vector<DerivativeColumns> derivatives_;  // in the order of the request
};

}  // namespace itn::tracer
