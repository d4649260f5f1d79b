# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs the built tree, builds the example against it as a stranger would, and runs it.
# In: build, source, config, example, work, write_clouds, generator, compiler, flags.
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

# The page for C++ names every installed header, and fusionslam.hpp includes all but pcl.hpp.
function(check_header_lists folder page)
  file(GLOB_RECURSE headers RELATIVE ${folder} ${folder}/*.hpp)
  file(READ ${page} listed)
  file(READ ${folder}/fusionslam.hpp included)
  foreach(header IN LISTS headers)
    string(FIND "${listed}" "`${header}`" on_page)
    string(FIND "${included}" "fusionslam/${header}" in_header)
    if(on_page EQUAL -1)
      message(FATAL_ERROR "${page} does not name ${header}")
    endif()
    if(in_header EQUAL -1 AND NOT header MATCHES "^(pcl|fusionslam)\\.hpp$")
      message(FATAL_ERROR "fusionslam.hpp does not include ${header}")
    endif()
  endforeach()
endfunction()

# A code block of the page for C++: the first of a language below a heading.
function(read_block heading language result)
  file(READ ${source}/docs/reference/cpp.md text)
  foreach(before "## ${heading}\n" "```${language}\n")
    string(FIND "${text}" "${before}" start)
    if(start EQUAL -1)
      message(FATAL_ERROR "the page for C++ lacks '${before}' (${heading})")
    endif()
    string(SUBSTRING "${text}" ${start} -1 text)
  endforeach()
  string(REGEX REPLACE "^```[a-z]+\n([^`]*)```.*$" "\\1" text "${text}")
  set(${result} "${text}" PARENT_SCOPE)
endfunction()

function(check_cache file)
  file(STRINGS ${file} found REGEX "^(PCL_DIR|OpenCV_DIR|Eigen3_DIR|CMAKE_C_COMPILER):")
  if(found)
    message(FATAL_ERROR "the consumer had to look for: ${found}")
  endif()
endfunction()

function(expect_failure words)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code OUTPUT_QUIET ERROR_VARIABLE text)
  string(REGEX REPLACE "[ \n]+" " " text "${text}")
  if(code EQUAL 0 OR NOT text MATCHES "${words}")
    message(FATAL_ERROR "${ARGN}: expected a failure that says '${words}', got ${code}:\n${text}")
  endif()
endfunction()

file(REMOVE_RECURSE ${work})
file(MAKE_DIRECTORY ${work}/clouds)
run(${CMAKE_COMMAND} --install ${build} --prefix ${work}/prefix --config "${config}")
check_headers(${work}/prefix/include)
check_header_lists(${work}/prefix/include/fusionslam ${source}/docs/reference/cpp.md)
foreach(file LICENSE third_party_notes.md)
  if(NOT EXISTS ${work}/prefix/share/doc/fusionslam/${file})
    message(FATAL_ERROR "${file} was not installed")
  endif()
endforeach()

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

# By components: an unknown one is refused, and pcl brings what programs with pcl.hpp need, in a
# project without the language C.
set(find_with -G ${generator} -D CMAKE_PREFIX_PATH=${work}/prefix -D CMAKE_CXX_COMPILER=${compiler}
    "-DCMAKE_CXX_FLAGS=${flags}" "-DCMAKE_BUILD_TYPE=${config}" -S ${work}/components)
file(WRITE ${work}/components/main.cpp [[
#include <fusionslam/pcl.hpp>
int main() { return static_cast<int>(fusionslam::points_view(pcl::PointCloud<pcl::PointXYZ>()).size); }
]])
file(WRITE ${work}/components/CMakeLists.txt [[
cmake_minimum_required(VERSION 3.16)
project(components LANGUAGES CXX)
find_package(fusionslam REQUIRED COMPONENTS core ${wanted})
add_executable(components main.cpp)
target_link_libraries(components PRIVATE fusionslam::pcl)
]])
expect_failure("no component cuda, expected core or pcl" ${CMAKE_COMMAND} ${find_with}
               -D wanted=cuda -B ${work}/build-cuda)
expect_failure("needs PCL" ${CMAKE_COMMAND} ${find_with} -D wanted=pcl
               -D CMAKE_DISABLE_FIND_PACKAGE_PCL=ON -B ${work}/build-without-pcl)

# The code of the page for C++, with the least that makes programs of it.
read_block("Use it in another project" cmake project)
read_block("PCL clouds" cmake pcl_project)
read_block("Describe and match" cpp find_places)
read_block("Interrupting" cpp describe)
read_block("PCL clouds" cpp describe_pcl)
file(WRITE ${work}/page/CMakeLists.txt "${project}")
file(WRITE ${work}/page/main.cpp "${find_places}${describe}" [[
int main() {
  std::vector<float> scan;
  for (int k = 0; k < 400; ++k) scan.push_back(static_cast<float>(k * k % 97));
  find_places(std::vector(52, scan));
  const std::vector<unsigned char> grey(300, 128);
  stop = true;
  try {
    describe({scan.data(), 100, 4}, {grey.data(), 100});
  } catch (const fusionslam::Interrupted&) {
    std::cout << "interrupted\n";
  }
}
]])
file(WRITE ${work}/page_pcl/CMakeLists.txt "${pcl_project}")
file(WRITE ${work}/page_pcl/main.cpp "${describe_pcl}" [[
#include <iostream>
int main() {
  pcl::PointCloud<pcl::PointXYZRGB> cloud;
  for (int k = 0; k < 100; ++k)
    cloud.push_back({static_cast<float>(k), static_cast<float>(k * k % 97), 0.1F, 10, 20, 30});
  std::cout << describe(cloud).size() << " numbers\n";
}
]])
foreach(name page page_pcl)
  run(${CMAKE_COMMAND} -G ${generator} -D CMAKE_PREFIX_PATH=${work}/prefix
      -D CMAKE_CXX_COMPILER=${compiler} "-DCMAKE_CXX_FLAGS=${flags}"
      "-DCMAKE_BUILD_TYPE=${config}" -S ${work}/${name} -B ${work}/${name}/build)
  run(${CMAKE_COMMAND} --build ${work}/${name}/build --config "${config}")
  file(GLOB_RECURSE program ${work}/${name}/build/my_robot)
  run(${program})
  string(APPEND said "${output}")
endforeach()
if(NOT said MATCHES "^0 at distance 0\n.*interrupted\n[0-9]+ numbers\n$")
  message(FATAL_ERROR "the programs of the page for C++ say:\n${said}")
endif()

# By pkg-config, which knows no CMake.
find_program(pkg_config NAMES pkg-config pkgconf)
if(pkg_config)
  file(GLOB_RECURSE pc ${work}/prefix/fusionslam.pc)
  run(${pkg_config} --cflags --libs ${pc})
  string(STRIP "${output}" options)
  separate_arguments(options UNIX_COMMAND "${flags} ${options}")
  file(GLOB library ${work}/prefix/lib*/libfusionslam.so ${work}/prefix/lib/*/libfusionslam.so)
  get_filename_component(library_folder ${library} DIRECTORY)
  run(${compiler} -std=c++20 ${example}/describe_and_match.cpp -o ${work}/by_pkg_config ${options}
      -Wl,-rpath,${library_folder})
  run(${work}/by_pkg_config ${clouds})
  if(NOT output MATCHES "2\\.bin is nearest to [^\n]*0\\.bin")
    message(FATAL_ERROR "built by pkg-config, the program says:\n${output}")
  endif()

  # The page's command, where c++ is the compiler of this build with its flags.
  read_block("Use it in another project" bash command)
  file(WRITE ${work}/bin/c++ "#!/bin/sh\nexec '${compiler}' ${flags} \"$@\"\n")
  file(CHMOD ${work}/bin/c++ PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE)
  run(${CMAKE_COMMAND} -E chdir ${work}/page ${CMAKE_COMMAND} -E env
      "PATH=${work}/bin:$ENV{PATH}" "PKG_CONFIG_PATH=${library_folder}/pkgconfig"
      sh -e -c "${command}")
  run(${CMAKE_COMMAND} -E env "LD_LIBRARY_PATH=${library_folder}" ${work}/page/a.out)
  if(NOT output MATCHES "^0 at distance 0\n.*interrupted\n$")
    message(FATAL_ERROR "built by the page's command, the program says:\n${output}")
  endif()
endif()
