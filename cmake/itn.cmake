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

# itn_batches(out name a.cpp ...): files that are compiled in their place, each of which includes ten
# of them: headers cost more than our lines. As CMake's unity builds, but by paths within the
# repository, so that what is compiled is the same in every clone.
function(itn_batches out name)
  list(LENGTH ARGN count)
  if(NOT ITN_UNITY OR count LESS 2)
    set(${out} ${ARGN} PARENT_SCOPE)
    return()
  endif()
  file(RELATIVE_PATH folder ${PROJECT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR})
  math(EXPR last "${count} - 1")
  foreach(first RANGE 0 ${last} 10)
    list(SUBLIST ARGN ${first} 10 includes)
    list(TRANSFORM includes REPLACE "(.+)" "#include \"${folder}/\\1\"")
    list(JOIN includes "\n" includes)
    set(batch ${CMAKE_CURRENT_BINARY_DIR}/batches/${name}_${first}.cpp)
    file(CONFIGURE OUTPUT ${batch} CONTENT "${includes}\n" @ONLY)
    list(APPEND batches ${batch})
  endforeach()
  set(${out} ${batches} PARENT_SCOPE)
endfunction()
if(ITN_UNITY)
  # Of types in files that are included.
  target_compile_options(itn_options INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()

function(itn_read_torch_headers_once target)
  if(TARGET torch_headers)
    target_precompile_headers(${target} REUSE_FROM torch_headers)
  endif()
endfunction()

# itn_library(name [TORCH] SOURCES a.cpp ... [SEPARATE b.cpp ...] LINK lib ...): a static library of
# ours. TORCH: most of its sources include LibTorch's headers. SEPARATE: more sources, each compiled
# by itself, as its names clash with others'.
function(itn_library name)
  cmake_parse_arguments(ARG "TORCH" "" "SOURCES;SEPARATE;LINK" ${ARGN})
  itn_batches(batches ${name} ${ARG_SOURCES})
  add_library(${name} STATIC ${batches} ${ARG_SEPARATE})
  target_link_libraries(${name} PUBLIC itn_options ${ARG_LINK})
  if(ARG_TORCH)
    itn_read_torch_headers_once(${name})
  endif()
endfunction()

# itn_program(name [TORCH] SOURCES a.cpp ... [SEPARATE b.cpp ...] LINK lib ...): a program of ours,
# called `name`.
function(itn_program name)
  cmake_parse_arguments(ARG "TORCH" "" "SOURCES;SEPARATE;LINK" ${ARGN})
  itn_batches(batches ${name} ${ARG_SOURCES})
  add_executable(${name} ${batches} ${ARG_SEPARATE})
  target_link_libraries(${name} PRIVATE itn_options ${ARG_LINK})
  if(ARG_TORCH)
    itn_read_torch_headers_once(${name})
  endif()
endfunction()

# Files of tests are below the build's folder: builds beside each other do not meet in them. Threads
# of LibTorch's wait as they do in our programs (common/passive_waiting.h): where they spin, two
# tests at a time take ten times as long.
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/Testing/files)
file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/test_environment.cmake @ONLY CONTENT [[
set(ENV{TEST_TMPDIR} "@CMAKE_BINARY_DIR@/Testing/files")
set(ENV{OMP_WAIT_POLICY} PASSIVE)
set(ENV{OPENBLAS_NUM_THREADS} 1)
]])
set_property(DIRECTORY ${PROJECT_SOURCE_DIR} APPEND PROPERTY
             TEST_INCLUDE_FILES ${CMAKE_BINARY_DIR}/test_environment.cmake)

# itn_test(name [TORCH] LABEL unit|physics|service|e2e SOURCES a.cpp ... LINK lib ...
#          [SEPARATE b.cpp ...] [TOGETHER suite ...] [NIGHTLY pattern ...] [SHARDS n]
#          [TIMEOUT seconds]): a GoogleTest program, each of its tests one CTest test with this label.
# TOGETHER: suites that share something that is dear to make: each is one CTest test. NIGHTLY: tests
# with the label nightly instead, as they take long. SHARDS: so many CTest tests run all others of the
# program, as each start of LibTorch takes half a second. TIMEOUT: for a machine that has six other
# things to do, by default two minutes.
function(itn_test name)
  cmake_parse_arguments(ARG "TORCH" "LABEL;SHARDS;TIMEOUT"
                        "SOURCES;LINK;SEPARATE;TOGETHER;NIGHTLY" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  itn_program(${name} SOURCES ${ARG_SOURCES} SEPARATE ${ARG_SEPARATE}
              LINK ${ARG_LINK} GTest::gmock GTest::gtest_main)
  if(ARG_TORCH)
    itn_read_torch_headers_once(${name})
  else()
    # What takes time is in the libraries: a third less for the compiler, as much for the tests. Not
    # with LibTorch, whose headers were read for the other level.
    target_compile_options(${name} PRIVATE $<$<CONFIG:Release>:-O1>)
  endif()
  set(properties LABELS ${ARG_LABEL} TIMEOUT ${ARG_TIMEOUT})
  # Those that take long go first, so that no single one is left in the end.
  if(ARG_LABEL STREQUAL physics)
    list(APPEND properties COST 10)
  endif()
  foreach(suite IN LISTS ARG_TOGETHER)
    add_test(NAME ${suite} COMMAND ${name} --gtest_filter=${suite}.*)
    set_tests_properties(${suite} PROPERTIES ${properties})
  endforeach()
  list(TRANSFORM ARG_TOGETHER APPEND ".*")
  list(JOIN ARG_NIGHTLY ":" nightly)
  list(JOIN ARG_TOGETHER ":" others)
  set(others "*-${others}:${nightly}")
  if(ARG_SHARDS)
    math(EXPR last "${ARG_SHARDS} - 1")
    foreach(shard RANGE ${last})
      add_test(NAME ${name}.${shard} COMMAND ${name} --gtest_filter=${others})
      set_tests_properties(${name}.${shard} PROPERTIES ${properties}
        ENVIRONMENT "GTEST_TOTAL_SHARDS=${ARG_SHARDS};GTEST_SHARD_INDEX=${shard}")
    endforeach()
  else()
    gtest_discover_tests(${name} DISCOVERY_TIMEOUT 300 TEST_FILTER "${others}"
                         PROPERTIES ${properties})
  endif()
  if(ARG_NIGHTLY)
    gtest_discover_tests(${name} DISCOVERY_TIMEOUT 300 TEST_FILTER "${nightly}"
                         TEST_LIST ${name}_nightly PROPERTIES LABELS nightly TIMEOUT 1800)
  endif()
endfunction()

# itn_avx2_test(name program filter): these tests of a program once more, as LibTorch and oneDNN
# compute on a processor without AVX-512 (label isa).
function(itn_avx2_test name program filter)
  set(files ${CMAKE_BINARY_DIR}/Testing/avx2/${name})
  file(MAKE_DIRECTORY ${files})
  add_test(NAME avx2.${name} COMMAND ${program} --gtest_filter=${filter})
  set_tests_properties(avx2.${name} PROPERTIES LABELS isa TIMEOUT 300
    ENVIRONMENT "DNNL_MAX_CPU_ISA=AVX2;ATEN_CPU_CAPABILITY=avx2;TEST_TMPDIR=${files}")
endfunction()

# itn_no_grpc_test(program): what the program is made of does not bring gRPC into it.
function(itn_no_grpc_test program)
  add_test(NAME ${program}.needs_no_grpc COMMAND sh -c "! ldd $<TARGET_FILE:${program}> | grep grpc")
  set_tests_properties(${program}.needs_no_grpc PROPERTIES LABELS unit)
endfunction()
