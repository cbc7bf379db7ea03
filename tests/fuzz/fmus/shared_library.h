/* Shared libraries, on Linux and on Windows. */
#ifndef INKLOOP_FUZZ_SHARED_LIBRARY_H
#define INKLOOP_FUZZ_SHARED_LIBRARY_H

#if defined(_WIN32)
#include <windows.h>
typedef FARPROC Symbol;
#define open_library(path) LoadLibraryA(path)
#define symbol_of(library, name) GetProcAddress((HMODULE)(library), name)
#else
#include <dlfcn.h>
typedef void *Symbol;
#define open_library(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define symbol_of(library, name) dlsym(library, name)
#endif

#endif
