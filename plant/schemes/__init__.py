"""Time-stepping schemes, each a model beside its kernel; `door` picks by the model's type."""
