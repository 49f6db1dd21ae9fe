// A driver of CUDA for tests without a GPU: what consumer_gpu calls, over mapped memory. Its device
// has the UUID in FAKE_CUDA_UUID (32 hexadecimal digits) and FAKE_CUDA_FREE bytes free. Work on the
// device is a line in FAKE_CUDA_LOG; an event is over once the file FAKE_CUDA_DONE exists, or if that
// is not set. What is queued on a stream is done when the stream is waited for, and not before.
#define _GNU_SOURCE
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

// Memory that processes share: a memfd whose descriptor is the shareable handle.
struct properties { int type, handles, location_type, location; void *win32; unsigned char flags[8]; };
struct shared { int fd; size_t size; };
enum { PAGE = 2 << 20, DESCRIPTOR = 1 };
CUresult cuMemGetInfo_v2(size_t *free_bytes, size_t *all) {
    const char *given = getenv("FAKE_CUDA_FREE");
    *all = (size_t)1 << 40;
    *free_bytes = given ? strtoull(given, NULL, 10) : *all;
    return depth < 1 ? INVALID : OK;
}
CUresult cuMemGetAllocationGranularity(size_t *page, const struct properties *wanted, int option) {
    *page = PAGE;
    return option || wanted->handles != DESCRIPTOR ? INVALID : OK;
}
CUresult cuMemCreate(struct shared **out, size_t size, const struct properties *wanted, unsigned long long flags) {
    if (flags || size % PAGE || wanted->type != 1 || wanted->handles != DESCRIPTOR || wanted->location_type != 1 || wanted->location) return INVALID;
    struct shared *made = malloc(sizeof *made);
    made->fd = memfd_create("fake_cuda", MFD_CLOEXEC);
    made->size = size;
    if (made->fd < 0 || ftruncate(made->fd, (off_t)size)) { free(made); return 2; }
    *out = made;
    note("create %zu", size);
    return OK;
}
CUresult cuMemExportToShareableHandle(void *out, struct shared *memory, int type, unsigned long long flags) {
    if (type != DESCRIPTOR || flags) return INVALID;
    *(int *)out = fcntl(memory->fd, F_DUPFD_CLOEXEC, 0);
    return OK;
}
CUresult cuMemImportFromShareableHandle(struct shared **out, void *descriptor, int type) {
    struct stat about;
    int fd = (int)(intptr_t)descriptor;
    if (type != DESCRIPTOR || fstat(fd, &about)) return INVALID;
    struct shared *made = malloc(sizeof *made);
    made->fd = fcntl(fd, F_DUPFD_CLOEXEC, 0);
    made->size = (size_t)about.st_size;
    *out = made;
    note("take over %zu", made->size);
    return OK;
}
CUresult cuMemRelease(struct shared *memory) { close(memory->fd); free(memory); return OK; }
CUresult cuMemAddressReserve(uint64_t *address, size_t size, size_t alignment, uint64_t wish, unsigned long long flags) {
    (void)alignment; (void)wish; (void)flags;
    void *base = mmap(NULL, size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    *address = (uint64_t)base;
    return base == MAP_FAILED || size % PAGE ? INVALID : OK;
}
CUresult cuMemMap(uint64_t address, size_t size, size_t offset, struct shared *memory, unsigned long long flags) {
    if (offset || flags || size > memory->size) return INVALID;
    void *base = mmap((void *)address, size, PROT_NONE, MAP_SHARED | MAP_FIXED, memory->fd, 0);
    return base == MAP_FAILED ? INVALID : OK;
}
struct access { int location_type, location, flags; };
CUresult cuMemSetAccess(uint64_t address, size_t size, const struct access *wanted, size_t n) {
    if (n != 1 || wanted->location_type != 1 || wanted->location) return INVALID;
    int allowed = wanted->flags == 3 ? PROT_READ | PROT_WRITE : wanted->flags == 1 ? PROT_READ : PROT_NONE;
    return mprotect((void *)address, size, allowed) ? INVALID : OK;
}
CUresult cuMemUnmap(uint64_t address, size_t size) {
    note("unmap");
    void *base = mmap((void *)address, size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED | MAP_NORESERVE, -1, 0);
    return base == MAP_FAILED ? INVALID : OK;
}
CUresult cuMemAddressFree(uint64_t address, size_t size) { return munmap((void *)address, size) ? INVALID : OK; }
CUresult cuPointerGetAttribute(void *out, int attribute, uint64_t address) {
    if (attribute != 9 || address < 4096) return INVALID;
    *(int *)out = 0;
    return OK;
}

// A stream is a list of copies that wait.
struct copy { void *to; const void *from; size_t size; };
struct stream { struct copy waiting[64]; int n; };
CUresult cuStreamCreate(struct stream **out, unsigned flags) { (void)flags; *out = calloc(1, sizeof **out); return OK; }
CUresult cuStreamDestroy_v2(struct stream *stream) { free(stream); return OK; }
CUresult cuStreamWaitEvent(struct stream *stream, void *event, unsigned flags) { (void)stream; (void)event; note("stream waits"); return flags ? INVALID : OK; }
static CUresult queue(struct stream *stream, void *to, const void *from, size_t size) {
    if (depth < 1 || !stream || stream->n == 64) return INVALID;
    stream->waiting[stream->n++] = (struct copy){to, from, size};
    return OK;
}
CUresult cuMemcpyDtoDAsync_v2(uint64_t to, uint64_t from, size_t size, struct stream *stream) { note("copy %zu", size); return queue(stream, (void *)to, (void *)from, size); }
CUresult cuMemcpyDtoHAsync_v2(void *to, uint64_t from, size_t size, struct stream *stream) { note("to host %zu", size); return queue(stream, to, (void *)from, size); }
CUresult cuMemcpyHtoDAsync_v2(uint64_t to, const void *from, size_t size, struct stream *stream) { note("from host %zu", size); return queue(stream, (void *)to, from, size); }
CUresult cuStreamSynchronize(struct stream *stream) {
    for (int i = 0; i < stream->n; i++) memcpy(stream->waiting[i].to, stream->waiting[i].from, stream->waiting[i].size);
    stream->n = 0;
    return OK;
}
CUresult cuCtxSynchronize(void) { note("wait for all"); return depth < 1 ? INVALID : OK; }

CUresult cuEventCreate(void **event, unsigned flags) { (void)flags; *event = malloc(1); return OK; }
CUresult cuEventRecord(void *event, void *stream) { (void)event; (void)stream; note("record stream"); return OK; }
CUresult cuCtxRecordEvent(void *context, void *event) { (void)event; note("record"); return context == (void *)64 ? OK : INVALID; }
CUresult cuEventQuery(void *event) { (void)event; return done() ? OK : NOT_READY; }
CUresult cuEventSynchronize(void *event) { (void)event; note("wait"); while (!done()) usleep(1000); return OK; }
CUresult cuEventDestroy_v2(void *event) { free(event); return OK; }
