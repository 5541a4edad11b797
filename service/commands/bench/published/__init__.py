"""The paper's step written with published libraries; the bench calls it."""
