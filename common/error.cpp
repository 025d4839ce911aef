#include "common/error.h"

namespace itn {

int exit_code(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kInternal: return 1;
    case ErrorKind::kUsage: return 2;
    case ErrorKind::kInvalidInput: return 3;
    case ErrorKind::kIo: return 4;
    case ErrorKind::kUnavailable: return 5;
    case ErrorKind::kDataLoss: return 6;
    case ErrorKind::kLimit: return 7;
    case ErrorKind::kCancelled: return 130;
  }
  return 1;
}

}  // namespace itn
