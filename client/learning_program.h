// The commands that need a network are in a program of their own, itn-learn, as LibTorch takes half
// a second and 150 MB to load: itn becomes it when one of them is called.
#pragma once

namespace itn {

// Runs itn-learn, which lies in the folder of this program, with the arguments of this process in
// its place. Throws Error (kIo) if it cannot be run.
[[noreturn]] void become_learning_program();

}  // namespace itn
