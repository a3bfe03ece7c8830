//! The test of the device on which the threshold of alphas relies.

use anyhow::Result;

use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Shader, Stage};
use crate::render::shaders::fast::{Denormals, DenormalsBindings};

/// Exponents whose powers of two are denormal numbers: from just below the smallest normal number to the smallest
/// denormal one.
const EXPONENTS: [f32; 2] = [-126.0001, -149.0];

/// True if `exp2` in shaders returns 0 instead of a denormal number. Vulkan leaves this to the driver
/// (VkPhysicalDeviceFloatControlsProperties), so it is tested.
///
/// # Errors
/// If the test cannot run.
pub fn flushes_denormals(device: &Device) -> Result<bool> {
    let (stage, len) = (Stage::<Denormals>::new(device, &())?, Denormals::WORKGROUP[0] as usize);
    let [exponents, powers] = [Buffer::<f32>::new(device, "exponents", len)?, Buffer::new(device, "powers", len)?];
    let [first, last] = EXPONENTS;
    let mut cmd = Commands::new(device)?;
    cmd.upload(&exponents, 0, len, |to| {
        let spread = |i: usize| first + (last - first) * i as f32 / (len - 1) as f32;
        to.iter_mut().enumerate().for_each(|(i, exponent)| *exponent = spread(i));
    })?;
    cmd.barrier(Access::COPY_WRITE, Access::SHADER);
    let bindings = DenormalsBindings { exponents: &exponents, powers: &powers };
    cmd.dispatch(&stage, bindings, (), DispatchSize::Groups(1));
    cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
    let read = cmd.read(&powers)?;
    Ok(cmd.submit()?.wait()?.view(&read).iter().all(|power| *power == 0.0))
}
