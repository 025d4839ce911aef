# How our own targets are compiled, in one place.
add_library(itn_options INTERFACE)
target_include_directories(itn_options INTERFACE ${PROJECT_SOURCE_DIR})
target_compile_options(itn_options INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wconversion
                                             -Wno-sign-conversion)
if(ITN_WERROR)
  target_compile_options(itn_options INTERFACE -Werror)
endif()
if(ITN_SANITIZE)
  target_compile_options(itn_options INTERFACE -fsanitize=${ITN_SANITIZE}
                                               -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(itn_options INTERFACE -fsanitize=${ITN_SANITIZE})
  # GCC 12 is wrong about std::regex under the address sanitizer.
  target_compile_options(itn_options INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
endif()
if(ITN_FUZZ)
  if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    message(FATAL_ERROR "ITN_FUZZ needs clang (preset fuzz), not ${CMAKE_CXX_COMPILER_ID}")
  endif()
  target_compile_options(itn_options INTERFACE -fsanitize=fuzzer-no-link)
endif()

# LibTorch's headers take the compiler eight seconds: it reads them once for all sources of targets
# with TORCH. Programs are compiled as libraries are, so that they share what it read. GCC's only:
# clang is for other things here (fuzzing, style).
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  set(CMAKE_CXX_COMPILE_OPTIONS_PIE ${CMAKE_CXX_COMPILE_OPTIONS_PIC})
  file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/torch_headers.cpp CONTENT "")
  add_library(torch_headers OBJECT ${CMAKE_BINARY_DIR}/torch_headers.cpp)
  target_link_libraries(torch_headers PRIVATE itn_options ${TORCH_LIBRARIES})
  target_compile_options(torch_headers PRIVATE -pthread)
  target_include_directories(torch_headers SYSTEM PRIVATE ${TORCH_INCLUDE_DIRS})
  target_precompile_headers(torch_headers PRIVATE <torch/types.h> <torch/nn/module.h>)
endif()

function(itn_read_torch_headers_once target)
  if(TARGET torch_headers)
    target_precompile_headers(${target} REUSE_FROM torch_headers)
  endif()
endfunction()

# itn_library(name [TORCH] SOURCES a.cpp ... LINK lib ...): a static library of ours. TORCH: most of
# its sources include LibTorch's headers.
function(itn_library name)
  cmake_parse_arguments(ARG "TORCH" "" "SOURCES;LINK" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_link_libraries(${name} PUBLIC itn_options ${ARG_LINK})
  if(ARG_TORCH)
    itn_read_torch_headers_once(${name})
  endif()
endfunction()

# itn_program(name [TORCH] SOURCES a.cpp ... LINK lib ...): a program of ours, called `name`.
function(itn_program name)
  cmake_parse_arguments(ARG "TORCH" "" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE itn_options ${ARG_LINK})
  if(ARG_TORCH)
    itn_read_torch_headers_once(${name})
  endif()
endfunction()

# itn_test(name [TORCH] LABEL unit|physics|service|e2e SOURCES a.cpp ... LINK lib ...
#          [TOGETHER suite ...] [TIMEOUT seconds]): a GoogleTest program, each of its tests one CTest
# test with this label, but for those of the suites TOGETHER, which share something that is dear to
# make: each such suite is one CTest test. The time limits are for a machine that has much else to
# do.
function(itn_test name)
  cmake_parse_arguments(ARG "TORCH" "LABEL;TIMEOUT" "SOURCES;LINK;TOGETHER" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 900)
  endif()
  itn_program(${name} SOURCES ${ARG_SOURCES} LINK ${ARG_LINK} GTest::gmock GTest::gtest_main)
  if(ARG_TORCH)
    itn_read_torch_headers_once(${name})
  else()
    # What takes time is in the libraries: a third less for the compiler, as much for the tests. Not
    # with LibTorch, whose headers were read for the other level.
    target_compile_options(${name} PRIVATE $<$<CONFIG:Release>:-O1>)
  endif()
  # Files of tests are below the build's folder: builds beside each other do not meet in them.
  file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/Testing/files)
  set(properties LABELS ${ARG_LABEL} TIMEOUT ${ARG_TIMEOUT}
                 ENVIRONMENT TEST_TMPDIR=${CMAKE_BINARY_DIR}/Testing/files)
  foreach(suite IN LISTS ARG_TOGETHER)
    add_test(NAME ${suite} COMMAND ${name} --gtest_filter=${suite}.*)
    set_tests_properties(${suite} PROPERTIES ${properties})
  endforeach()
  list(TRANSFORM ARG_TOGETHER APPEND ".*")
  list(JOIN ARG_TOGETHER ":" together)
  gtest_discover_tests(${name} DISCOVERY_TIMEOUT 300 TEST_FILTER "*-${together}"
                       PROPERTIES ${properties})
endfunction()
