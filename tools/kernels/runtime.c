/* The functions of numba's run-time that compiled kernels call: memory of arrays that kernels make,
   and powers of two.

   Counts of references are changed by the kernels' own code, or by `release`. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>

typedef void (*Destroy)(void *data, size_t size, void *info);

/* Laid out as numba's MemInfo: compiled code reads its fields. */
typedef struct {
    size_t references;
    Destroy destroy;
    void *info;
    void *data;
    size_t size;
    void *external;
} Memory;

void *NRT_MemInfo_alloc_aligned(size_t size, unsigned align) {
    if (size > SIZE_MAX - sizeof(Memory) - 2 * (size_t)align) return NULL;
    Memory *memory = malloc(sizeof(Memory) + size + 2 * (size_t)align);
    if (!memory) return NULL;
    uintptr_t first = (uintptr_t)(memory + 1);
    if (align) first = (first + align - 1) / align * align;
    *memory = (Memory){.references = 1, .data = (void *)first, .size = size};
    return memory;
}

void *NRT_MemInfo_alloc(size_t size) { return NRT_MemInfo_alloc_aligned(size, 16); }

void *NRT_MemInfo_alloc_safe(size_t size) { return NRT_MemInfo_alloc_aligned(size, 16); }

void *NRT_MemInfo_alloc_safe_aligned(size_t size, unsigned align) {
    return NRT_MemInfo_alloc_aligned(size, align);
}

void NRT_MemInfo_call_dtor(Memory *memory) {
    if (memory->destroy) memory->destroy(memory->data, memory->size, memory->info);
    free(memory);
}

void *NRT_Allocate(size_t size) { return malloc(size); }

void NRT_Free(void *data) { free(data); }

/* Powers of two, as numba calls them. */
double numba_frexp(double value, int *exponent) {
    *exponent = 0;
    return isfinite(value) ? frexp(value, exponent) : value;
}

double numba_ldexp(double value, int exponent) { return ldexp(value, exponent); }

/* Lists of kernels: memory that may grow. */
static void free_variable(void *data, size_t size, void *inner) {
    if (inner) ((Destroy)inner)(data, size, NULL);
    free(data);
}

void *NRT_MemInfo_new_varsize_dtor(size_t size, Destroy inner) {
    Memory *memory = malloc(sizeof(Memory));
    void *data = malloc(size ? size : 1);
    if (!memory || !data) {
        free(memory);
        free(data);
        return NULL;
    }
    *memory = (Memory){
        .references = 1, .destroy = free_variable, .info = (void *)inner, .data = data, .size = size};
    return memory;
}

void *NRT_MemInfo_varsize_realloc(Memory *memory, size_t size) {
    void *data = realloc(memory->data, size ? size : 1);
    if (!data) return NULL;
    memory->data = data;
    memory->size = size;
    return data;
}

/* One reference less to what a kernel gave. */
void release(void *given) {
    Memory *memory = given;
    if (memory && __atomic_sub_fetch(&memory->references, 1, __ATOMIC_SEQ_CST) == 0)
        NRT_MemInfo_call_dtor(memory);
}

float numba_nextafterf(float from, float to) { return nextafterf(from, to); }

double numba_nextafter(double from, double to) { return nextafter(from, to); }

/* Strides of a view of other dimensions, in C order; 0 if only a copy can have them.

   Source axes that follow each other without a gap are one run of numbers; each new axis, from the
   last, has to divide the run that is left. */
int numba_attempt_nocopy_reshape(intptr_t count, const intptr_t *dims, const intptr_t *strides,
                                 intptr_t new_count, const intptr_t *new_dims,
                                 intptr_t *new_strides, intptr_t itemsize, int is_fortran) {
    intptr_t axis = count - 1, run = 1, stride = itemsize, items = 1, new_items = 1, n;
    for (n = 0; n < count; n++) items *= dims[n];
    for (n = 0; n < new_count; n++) new_items *= new_dims[n];
    if (is_fortran || items != new_items) return 0;
    if (items == 0) axis = -1; /* nothing is read: any strides do */
    if (axis < 0)
        for (n = new_count - 1; n >= 0; n--) {
            new_strides[n] = stride;
            stride *= new_dims[n];
        }
    if (axis < 0) return 1;
    for (n = new_count - 1; n >= 0; n--) {
        while (run == 1 && axis >= 0) { /* the next run */
            run = dims[axis];
            stride = strides[axis];
            for (axis--; axis >= 0; axis--) {
                if (dims[axis] == 1) continue;
                if (run == 1) {
                    stride = strides[axis];
                } else if (strides[axis] != stride * run) {
                    break;
                }
                run *= dims[axis];
            }
        }
        new_strides[n] = stride;
        if (new_dims[n] == 1) continue;
        if (run % new_dims[n]) return 0;
        run /= new_dims[n];
        stride *= new_dims[n];
    }
    return 1;
}

/* glibc has some functions twice: a newer version leaves errno alone and is the same otherwise.
   Calls go to the first version, with which the library runs on older systems. */
#ifdef __GLIBC__
#if defined(__x86_64__)
#define OLDEST "GLIBC_2.2.5"
#elif defined(__aarch64__)
#define OLDEST "GLIBC_2.17"
#else
#error "platforms.py wraps functions of glibc's on x86-64 and aarch64"
#endif
#define FIRST(name) __asm__(".symver first_" #name "," #name "@" OLDEST)
#define ONE(type, name)              \
    FIRST(name);                     \
    type first_##name(type);         \
    type __wrap_##name(type number); \
    type __wrap_##name(type number) { return first_##name(number); }
#define TWO(type, name)                  \
    FIRST(name);                         \
    type first_##name(type, type);       \
    type __wrap_##name(type one, type two); \
    type __wrap_##name(type one, type two) { return first_##name(one, two); }

ONE(double, exp) ONE(double, exp2) ONE(double, log) ONE(double, log2)
ONE(float, expf) ONE(float, exp2f) ONE(float, logf) ONE(float, log2f)
TWO(double, pow) TWO(double, hypot) TWO(double, fmod)
TWO(float, powf) TWO(float, hypotf) TWO(float, fmodf)
#endif
