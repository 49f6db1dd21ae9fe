// A driver of CUDA for tests without a GPU: what consumer_gpu calls, over mapped memory. Its device
// has the UUID in FAKE_CUDA_UUID (32 hexadecimal digits). Work on the device is a line in
// FAKE_CUDA_LOG; an event is over once the file FAKE_CUDA_DONE exists, or if that is not set.
#include <fcntl.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

typedef int CUresult;
enum { OK = 0, INVALID = 1, NOT_READY = 600 };

static void note(const char *format, ...) {
    const char *path = getenv("FAKE_CUDA_LOG");
    if (!path) return;
    FILE *file = fopen(path, "a");
    if (!file) return;
    va_list values;
    va_start(values, format);
    vfprintf(file, format, values);
    va_end(values);
    fputc('\n', file);
    fclose(file);
}

static int done(void) {
    const char *path = getenv("FAKE_CUDA_DONE");
    return !path || access(path, F_OK) == 0;
}

struct external { int fd; size_t size; void *base; };

CUresult cuInit(unsigned flags) { return flags ? INVALID : OK; }
CUresult cuDriverGetVersion(int *version) { *version = 12080; return OK; }
CUresult cuDeviceGetCount(int *n) { *n = 1; return OK; }
CUresult cuDeviceGet(int *device, int ordinal) { *device = ordinal; return ordinal ? INVALID : OK; }
CUresult cuDeviceGetName(char *name, int length, int device) {
    const char *given = getenv("FAKE_CUDA_NAME");
    (void)device;
    snprintf(name, length, "%s", given ? given : "a device for tests");
    return OK;
}
CUresult cuDeviceGetUuid_v2(char *uuid, int device) {
    const char *digits = getenv("FAKE_CUDA_UUID");
    (void)device;
    for (int i = 0; i < 16; i++) {
        unsigned byte = 0;
        if (digits) sscanf(digits + 2 * i, "%2x", &byte);
        uuid[i] = (char)byte;
    }
    return OK;
}
CUresult cuDevicePrimaryCtxRetain(void **context, int device) { (void)device; *context = (void *)64; return OK; }
static __thread int depth;
CUresult cuCtxPushCurrent_v2(void *context) { depth++; return context == (void *)64 ? OK : INVALID; }
CUresult cuCtxPopCurrent_v2(void **context) { *context = (void *)64; return --depth < 0 ? INVALID : OK; }

struct handle { int type; int pad; union { int fd; void *two[2]; } handle; unsigned long long size; unsigned flags; unsigned reserved[16]; };
CUresult cuImportExternalMemory(void **out, const struct handle *wanted) {
    struct stat about;
    // Opaque descriptors of dedicated memory; the real driver accepts a wrong size in silence.
    if (depth < 1 || wanted->type != 1 || wanted->flags != 1 || fstat(wanted->handle.fd, &about)) return INVALID;
    if ((unsigned long long)about.st_size < wanted->size) return INVALID;
    struct external *made = malloc(sizeof *made);
    made->fd = wanted->handle.fd;
    made->size = wanted->size;
    // Mesa's software adapter keeps a header of its own in the first page.
    made->base = mmap(NULL, made->size + 4096, PROT_READ, MAP_SHARED, made->fd, 0);
    if (made->base == MAP_FAILED) { free(made); return INVALID; }
    *out = made;
    note("import %llu", wanted->size);
    return OK;
}
struct range { unsigned long long offset, size; unsigned flags; unsigned reserved[16]; };
CUresult cuExternalMemoryGetMappedBuffer(uint64_t *address, struct external *memory, const struct range *range) {
    if (range->offset + range->size > memory->size) return INVALID;
    *address = (uint64_t)memory->base + 4096 + range->offset;
    return OK;
}
CUresult cuDestroyExternalMemory(struct external *memory) {
    note("destroy");
    munmap(memory->base, memory->size + 4096);
    close(memory->fd);
    free(memory);
    return OK;
}
CUresult cuMemAlloc_v2(uint64_t *address, size_t size) { *address = (uint64_t)malloc(size); note("alloc %zu", size); return OK; }
// Memory that was mapped, and not allocated, goes with its import.
CUresult cuMemFree_v2(uint64_t address) { (void)address; note("free"); return OK; }
CUresult cuMemHostAlloc(void **host, size_t size, unsigned flags) { (void)flags; *host = malloc(size); return OK; }
CUresult cuMemFreeHost(void *host) { free(host); return OK; }
CUresult cuMemcpyDtoH_v2(void *to, uint64_t from, size_t size) { memcpy(to, (void *)from, size); return OK; }
CUresult cuMemcpyHtoD_v2(uint64_t to, const void *from, size_t size) { memcpy((void *)to, from, size); note("upload %zu", size); return OK; }
CUresult cuEventCreate(void **event, unsigned flags) { (void)flags; *event = malloc(1); return OK; }
CUresult cuEventRecord(void *event, void *stream) { (void)event; (void)stream; note("record stream"); return OK; }
CUresult cuCtxRecordEvent(void *context, void *event) { (void)event; note("record"); return context == (void *)64 ? OK : INVALID; }
CUresult cuEventQuery(void *event) { (void)event; return done() ? OK : NOT_READY; }
CUresult cuEventSynchronize(void *event) { (void)event; note("wait"); while (!done()) usleep(1000); return OK; }
CUresult cuEventDestroy_v2(void *event) { free(event); return OK; }
