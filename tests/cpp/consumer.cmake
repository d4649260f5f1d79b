# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs the built tree, builds the example against it as a stranger would, and runs it.
# In: build, config, example, work, write_clouds, generator, compiler, flags.
cmake_minimum_required(VERSION 3.25)

function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE code OUTPUT_VARIABLE text ERROR_VARIABLE text)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "${ARGV} failed with ${code}:\n${text}")
  endif()
  set(output "${text}" PARENT_SCOPE)
endfunction()

function(check_headers folder)
  file(GLOB_RECURSE headers ${folder}/*.hpp)
  if(NOT headers)
    message(FATAL_ERROR "no headers were installed into ${folder}")
  endif()
  foreach(header IN LISTS headers)
    file(STRINGS ${header} includes REGEX "^#include *[<\"](pcl|opencv|opencv2|Eigen|unsupported)/")
    if(includes AND NOT header MATCHES "/fusionslam/pcl\\.hpp$")
      message(FATAL_ERROR "${header} includes what a consumer may not have: ${includes}")
    endif()
  endforeach()
endfunction()

function(check_cache file)
  file(STRINGS ${file} found REGEX "^(PCL_DIR|OpenCV_DIR|Eigen3_DIR|CMAKE_C_COMPILER):")
  if(found)
    message(FATAL_ERROR "the consumer had to look for: ${found}")
  endif()
endfunction()

function(expect_failure words)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code OUTPUT_QUIET ERROR_VARIABLE text)
  if(code EQUAL 0 OR NOT text MATCHES "${words}")
    message(FATAL_ERROR "${ARGN}: expected a failure that says '${words}', got ${code}:\n${text}")
  endif()
endfunction()

file(REMOVE_RECURSE ${work})
file(MAKE_DIRECTORY ${work}/clouds)
run(${CMAKE_COMMAND} --install ${build} --prefix ${work}/prefix --config "${config}")
check_headers(${work}/prefix/include)

run(${CMAKE_COMMAND} -S ${example} -B ${work}/build -G ${generator}
    -D CMAKE_PREFIX_PATH=${work}/prefix -D CMAKE_CXX_COMPILER=${compiler}
    "-DCMAKE_CXX_FLAGS=${flags}" "-DCMAKE_BUILD_TYPE=${config}")
check_cache(${work}/build/CMakeCache.txt)
run(${CMAKE_COMMAND} --build ${work}/build --config "${config}")

run(${write_clouds} ${work}/clouds)
file(GLOB_RECURSE program ${work}/build/describe_and_match)
set(clouds ${work}/clouds/0.bin ${work}/clouds/1.bin ${work}/clouds/2.bin)
run(${program} ${clouds})
message("${output}")
if(NOT output MATCHES "2\\.bin is nearest to [^\n]*0\\.bin")
  message(FATAL_ERROR "the moved scan was not recognised:\n${output}")
endif()
expect_failure("missing\\.bin" ${program} ${work}/missing.bin)
file(WRITE ${work}/clouds/cut.bin "17 bytes, not 16.")
expect_failure("cut\\.bin.*multiple of 16" ${program} ${work}/clouds/cut.bin)
