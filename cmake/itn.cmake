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

# itn_library(name SOURCES a.cpp ... LINK lib ...): a static library of ours.
function(itn_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_link_libraries(${name} PUBLIC itn_options ${ARG_LINK})
endfunction()

# itn_program(name SOURCES a.cpp ... LINK lib ...): a program of ours, called `name`.
function(itn_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE itn_options ${ARG_LINK})
endfunction()

# itn_test(name LABEL unit|physics|service|e2e SOURCES a.cpp ... LINK lib ...
#          [TOGETHER suite ...] [TIMEOUT seconds]): a GoogleTest program, each of its tests one CTest
# test with this label, but for those of the suites TOGETHER, which share something that is dear to
# make: each such suite is one CTest test. The time limits are for a machine that has much else to
# do.
function(itn_test name)
  cmake_parse_arguments(ARG "" "LABEL;TIMEOUT" "SOURCES;LINK;TOGETHER" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 900)
  endif()
  itn_program(${name} SOURCES ${ARG_SOURCES} LINK ${ARG_LINK} GTest::gmock GTest::gtest_main)
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
