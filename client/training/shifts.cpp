#include "client/training/shifts.h"

#include <utility>
#include <vector>

#include "client/scene/text_proto.h"

namespace itn {

std::span<const Shift> shifts() {
  static const std::vector<Shift> kShifts = [] {
    std::vector<Shift> all;
    // A camera that does nothing but put another background behind the border of the object, as all
    // do, still has to do something.
    for (const auto& [name, text] : {
             std::pair{"another background", "camera { contrast: 1e-9 }"},
             std::pair{"exposure off by half a stop", "exposure: 0.35"},
             std::pair{"white balance off by 10 %", "white_balance: 0.1"},
             std::pair{"contrast off by 20 %", "camera { contrast: 0.2 }"},
             std::pair{"film's shoulder", "camera { shoulder: 1.5 }"},
             std::pair{"dark corners", "camera { vignetting: 0.5 }"},
             std::pair{"blur of a pixel", "camera { blur: 1 }"},
             std::pair{"a tenth clipped", "camera { clipped: 0.1 }"},
             std::pair{"mask off by a pixel", "camera { mask: 1 }"},
         }) {
      Shift& shift = all.emplace_back(Shift{.name = name, .change = {}});
      parse_text_proto(text, name, shift.change);
    }
    return all;
  }();
  return kShifts;
}

}  // namespace itn
